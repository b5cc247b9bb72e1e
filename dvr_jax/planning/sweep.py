"""Sweeps: labels for the action sequences of many scenes, kept shard by shard, so that a sweep can be stopped.

The folder of a sweep holds one Parquet shard (`dvr_jax.dataset.shards`) for each so many consecutive scenes, and
`_manifest.json`. A shard is written whole once all its scenes are done; until then, a journal keeps the labels of
each scene (`dvr_jax.planning.label_journal`). A sweep that was killed goes on with the scenes that are missing, and
ends with the same rows: they depend neither on the number of workers nor on what shares a batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from dvr_jax import __version__
from dvr_jax.dataset.folder_manifest import write_manifest
from dvr_jax.dataset.footer import ShardInfo
from dvr_jax.dataset.labelling import LabelOptions
from dvr_jax.dataset.shards import list_shards, read_columns, write_shard
from dvr_jax.errors import DataError, OptionError
from dvr_jax.planning.label_journal import LabelJournal
from dvr_jax.planning.label_workers import LabelTask, label_on_workers, label_scenes
from dvr_jax.runtime.files import require_folder
from dvr_jax.runtime.progress import Progress
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

    shards = _missing_shards(request, len(scenes), finished)
    _label_and_write(request, scenes, shards)
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


def _missing_shards(
    request: Sweep, number_of_scenes: int, finished: Sequence[ShardInfo]
) -> list[range]:
    """Return the scenes of each shard that is missing; refuse shards of another size."""
    covered = {index for info in finished for index in info.scenes}
    missing = []

    for first in range(0, number_of_scenes, request.shard):
        indices = range(first, min(first + request.shard, number_of_scenes))
        if covered.issuperset(indices):
            continue
        if covered.intersection(indices):
            raise OptionError(
                f"--shard is {request.shard}; scenes {first} to {indices[-1]} are in shards of another size."
            )
        missing.append(indices)

    return missing


def _divide(shards: Sequence[list[int]], workers: int) -> list[list[int]]:
    """Divide the scenes of shards into tasks, so that each worker has one even if there are fewer shards."""
    if not shards:
        return []

    parts = -(-workers // len(shards))
    return [shard[part::parts] for shard in shards for part in range(parts) if shard[part::parts]]


def _label_and_write(request: Sweep, scenes: Sequence[Scene], shards: Sequence[range]) -> None:
    """Label the scenes of shards, keep the labels of each scene, and write each shard once its scenes are done."""
    journal = LabelJournal(request.out, request.footer, scenes)
    waiting = {indices: set(indices) - journal.labels.keys() for indices in shards}
    shard_of = {index: indices for indices in shards for index in indices}
    pieces = _divide([sorted(left) for left in waiting.values() if left], request.workers)
    tasks = [
        LabelTask({index: scenes[index] for index in piece}, request.labelling, request.width)
        for piece in pieces
    ]

    def write_if_complete(indices: range) -> None:
        """Write a shard if all of its scenes are done."""
        if waiting[indices]:
            return
        labels = [label for index in indices for label in journal.labels[index]]
        path = request.out / f"labels-{indices.start:06d}.parquet"
        write_shard(path, {index: scenes[index] for index in indices}, labels, request.footer)
        journal.remove(indices)

    for indices in shards:
        write_if_complete(indices)

    done = len(scenes) - sum(map(len, waiting.values()))
    with Progress("labeling", len(scenes), "scenes", done) as progress:
        for index, labels in label_on_workers(tasks, request.workers, request.ray):
            indices = shard_of[index]
            if index in waiting[indices]:
                journal.add(index, labels)
                waiting[indices].remove(index)
                write_if_complete(indices)
                progress.advance()
