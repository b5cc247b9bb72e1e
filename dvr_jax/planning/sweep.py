"""Sweeps: labels for the action sequences of many scenes, kept shard by shard, so that a sweep can be stopped.

The folder of a sweep holds one Parquet shard (`dvr_jax.dataset.shards`) for each so many consecutive scenes, and
`_manifest.json`. A shard is written whole once all its scenes are done. A sweep that was killed goes on with the shards
that are missing, and ends with the same rows: they depend neither on the number of workers nor on what shares a batch.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from dvr_jax import __version__
from dvr_jax.dataset.folder_manifest import write_manifest
from dvr_jax.dataset.footer import ShardInfo
from dvr_jax.dataset.labelling import LabelOptions
from dvr_jax.dataset.labels import Label
from dvr_jax.dataset.shards import list_shards, read_columns, write_shard
from dvr_jax.errors import DataError, OptionError
from dvr_jax.planning.label_workers import LabelTask, label_on_processes, label_on_ray, label_scenes
from dvr_jax.runtime.files import require_folder
from dvr_jax.scene.files import are_equal_but_for_rounding, load_scenes, scene_from_json
from dvr_jax.scene.types import Scene

__all__ = ["Sweep", "label_scenes", "sweep"]


@dataclass(frozen=True, slots=True)
class Sweep:
    """What a sweep labels, how, and where its shards go."""

    scenes: Path
    """JSON Lines file of scenes."""
    out: Path
    """Folder of the shards; shards that it holds are kept."""
    labelling: LabelOptions
    """What the labels depend on."""
    shard: int
    """Number of scenes in a shard."""
    width: int
    """Number of scenes whose solves share a batch."""
    workers: int
    """Number of processes of this machine, which label one shard each at a time."""
    ray: str | None = None
    """Address of a Ray cluster whose CPUs take the workers' place."""

    @property
    def footer(self) -> dict[str, object]:
        """Options as the shards keep them."""
        return asdict(self.labelling)


def sweep(request: Sweep, command: Sequence[str] = ()) -> None:
    """Label all scenes of a file whose shards are missing, and report the progress on standard error.

    Args:
        request: Scenes, options and folder.
        command: Command line that the manifest names.

    Raises:
        DataError: The folder holds shards of another sweep, of another version or of other scenes.
        OptionError: The shards there have another size, or there is no Ray cluster at the address.
        DvrError: The file of scenes is broken.
        OSError: A file cannot be read or written.
    """
    scenes = load_scenes(request.scenes)
    require_folder(request.out)

    # Shards that are there count only if this sweep would have written the same.
    finished = list_shards(request.out)
    for info in finished:
        _require_same_sweep(request, info, scenes)

    tasks = _missing_tasks(request, scenes, finished)
    _label_and_write(request, tasks, number_of_scenes=len(scenes))
    write_manifest(request.out, list(command))


def _require_same_sweep(request: Sweep, info: ShardInfo, scenes: Sequence[Scene]) -> None:
    """Refuse a shard that this sweep would not have written."""
    advice = "choose another --out"

    if info.footer.options != request.footer:
        raise DataError(f"{info.path} comes of another sweep ({info.footer.options}); {advice}.")

    writer = info.footer.versions["dvr_jax"]
    if writer != __version__:
        raise DataError(
            f"{info.path} was made by dvr_jax {writer}, this is {__version__}; {advice}."
        )

    if info.scenes.stop > len(scenes):
        raise DataError(
            f"{info} goes beyond the {len(scenes)} scenes of {request.scenes}; {advice}."
        )

    found = (scene_from_json(text, str(info.path)) for text in read_columns(info).scene_texts)
    expected = scenes[info.scenes.start : info.scenes.stop]
    if not all(map(are_equal_but_for_rounding, found, expected)):
        raise DataError(f"{info.path} holds other scenes than {request.scenes}; {advice}.")


def _missing_tasks(
    request: Sweep, scenes: Sequence[Scene], finished: Sequence[ShardInfo]
) -> list[LabelTask]:
    """Return one task for each shard that is missing; refuse shards of another size."""
    covered = {index for info in finished for index in info.scenes}
    tasks = []

    for first in range(0, len(scenes), request.shard):
        stop = min(first + request.shard, len(scenes))
        indices = range(first, stop)
        if covered.issuperset(indices):
            continue
        if covered.intersection(indices):
            raise OptionError(
                f"--shard is {request.shard}; scenes {first} to {stop - 1} are in shards of another size."
            )
        tasks.append(LabelTask(scenes[first:stop], first, request.labelling, request.width))

    return tasks


def _label(request: Sweep, tasks: Sequence[LabelTask]) -> Iterator[tuple[LabelTask, list[Label]]]:
    """Yield each task with its labels, as it is done."""
    if request.ray is not None:
        return label_on_ray(tasks, request.ray)
    return label_on_processes(tasks, request.workers)


def _label_and_write(request: Sweep, tasks: Sequence[LabelTask], number_of_scenes: int) -> None:
    """Label tasks, write the shard of each one as it is done, and report the progress."""
    total = sum(len(task.scenes) for task in tasks)
    begin = time.monotonic()
    count = 0

    for task, labels in _label(request, tasks):
        path = request.out / f"labels-{task.first:06d}.parquet"
        indexed = dict(enumerate(task.scenes, start=task.first))
        write_shard(path, indexed, labels, request.footer)

        count += len(task.scenes)
        seconds = time.monotonic() - begin
        hourly = 3600 * count / seconds
        minutes_left = (total - count) * seconds / count / 60
        print(
            f"{number_of_scenes - total + count} of {number_of_scenes} scenes, {hourly:.0f} an hour, "
            f"{minutes_left:.0f} min to go",
            file=sys.stderr,
            flush=True,
        )
