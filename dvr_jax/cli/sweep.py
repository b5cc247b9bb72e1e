"""Command line `python -m dvr_jax.sweep --scenes FILE.jsonl --out DIR`: label action sequences of many scenes.

DIR then holds one Parquet shard (`dvr_jax.dataset.shards`) for each `--shard` consecutive scenes, and `_manifest.json`.
A shard is written whole once all its scenes are done; a sweep that was killed goes on with the shards that are not
there, and ends with the same rows. They depend neither on the number of workers nor on what shares a batch.

Shards are labelled by processes of this machine or, with `--ray ADDRESS`, by the machines of a Ray cluster on which
this package is installed; they are written here.
"""

from __future__ import annotations

import logging
import os
import socket
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass
from pathlib import Path

import jax
import tyro

from dvr_jax import __version__
from dvr_jax.dataset.folder_manifest import write_manifest
from dvr_jax.dataset.labelling import LabelOptions, label_scene
from dvr_jax.dataset.labels import Label
from dvr_jax.dataset.shards import list_shards, read_columns, write_shard
from dvr_jax.errors import DvrError, run_command
from dvr_jax.planning.feasibility import passes_check
from dvr_jax.runtime.processes import worker_processes
from dvr_jax.scene.files import are_equal_but_for_rounding, load_scenes, scene_from_json
from dvr_jax.scene.types import Scene
from dvr_jax.search.work import run_together

_DEFAULT = LabelOptions()


@dataclass(frozen=True)
class SweepOptions:
    """Label sequences of each scene, in order of length, until enough of them are feasible.

    A sweep that was stopped goes on when the same command is given again; a shard is written once it is complete."""

    scenes: Path
    """JSON Lines file, one scene a line (`python -m dvr_jax.sample` draws them)."""
    out: Path
    """Folder of the shards; those that are there are kept."""
    solutions: int = _DEFAULT.solutions
    """Feasible sequences after which a scene is done."""
    leaves: int = _DEFAULT.leaves
    """Sequences that reach the goal and that the pose bound does not refute, after which a scene is done."""
    k_max: int = _DEFAULT.k_max
    """Largest number of actions."""
    seed: int = _DEFAULT.seed
    """Of the solver's samples."""
    shard: int = 50
    """Scenes in a shard; progress is told, and kept, shard by shard."""
    width: int = 32
    """Scenes whose solves share a batch."""
    workers: int = os.cpu_count() or 1
    """Processes, one shard each at a time."""
    ray: str | None = None
    """Address of a Ray cluster ("auto": the one that runs on this machine), whose CPUs take the workers' place."""

    def check(self) -> None:
        """Refuse values that make no sense."""
        for name in ("solutions", "leaves", "k_max", "shard", "width", "workers"):
            if getattr(self, name) < 1:
                raise DvrError(f"--{name.replace('_', '-')} is {getattr(self, name)}; valid is 1 or more.")
        if self.seed < 0:
            raise DvrError(f"--seed is {self.seed}; valid is 0 or more.")

    @property
    def labelling(self) -> LabelOptions:
        """What labels depend on."""
        return LabelOptions(self.solutions, self.leaves, self.k_max, self.seed)


def label_scenes(
    scenes: Sequence[Scene], first: int, options: LabelOptions, width: int
) -> Iterator[tuple[int, list[Label]]]:
    """Labels of scenes with the indices from ``first`` on, as they are done; ``width`` scenes share batches."""
    with jax.enable_x64(True):
        labelled = (label_scene(scene, first + i, options, passes_check) for i, scene in enumerate(scenes))
        for index, labels in run_together(labelled, width):
            yield first + index, labels


def _label_shard(scenes: Sequence[Scene], first: int, options: LabelOptions, width: int) -> list[Label]:
    """Labels of the scenes of one shard."""
    return [label for _, found in label_scenes(scenes, first, options, width) for label in found]


_Task = tuple[Sequence[Scene], int, LabelOptions, int]
"""Arguments of `_label_shard`."""


def _on_processes(tasks: Sequence[_Task], workers: int) -> Iterator[tuple[_Task, list[Label]]]:
    """Labels of each task as it ends, by processes of this machine."""
    with worker_processes(workers) as pool:
        futures = {pool.submit(_label_shard, *task): task for task in tasks}
        for future in as_completed(futures):
            yield futures.pop(future), future.result()


def _on_ray(tasks: Sequence[_Task], address: str) -> Iterator[tuple[_Task, list[Label]]]:
    """Labels of each task as it ends, by a Ray cluster; tasks of a machine that is lost are given to another."""
    try:
        import ray
    except ImportError:
        raise DvrError(
            "--ray needs Ray, which is not installed; `pip install '.[ray]'` in the repository does."
        ) from None
    try:
        host, _, port = address.removeprefix("ray://").rpartition(":")
        if host:
            # Ray itself tries for minutes.
            socket.create_connection((host, int(port)), timeout=10).close()
        ray.init(address, log_to_driver=False, logging_level=logging.ERROR)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise DvrError(f"--ray {address}: {reason}; valid is the address of a running cluster, or auto.") from None
    try:
        label = ray.remote(num_cpus=1, max_retries=-1)(_label_shard)
        waiting = {label.remote(*task): task for task in tasks}
        while waiting:
            (done,), _ = ray.wait(list(waiting), num_returns=1)
            yield waiting.pop(done), ray.get(done)
    finally:
        ray.shutdown()


def sweep(options: SweepOptions) -> None:
    """Label all scenes of the file whose shards are not there yet."""
    options.check()
    scenes = load_scenes(options.scenes)
    footer: dict[str, object] = asdict(options.labelling)
    options.out.mkdir(parents=True, exist_ok=True)
    done = list_shards(options.out)
    for info in done:
        if info.footer.options != footer:
            raise DvrError(f"{info.path} comes of another sweep ({info.footer.options}); choose another --out.")
        if (writer := info.footer.versions["dvr_jax"]) != __version__:
            raise DvrError(f"{info.path} was made by dvr_jax {writer}, this is {__version__}; choose another --out.")
        if info.scenes.stop > len(scenes):
            raise DvrError(f"{info} goes beyond the {len(scenes)} scenes of {options.scenes}; choose another --out.")
        labelled = (scene_from_json(text, str(info.path)) for text in read_columns(info).scene_texts)
        if not all(map(are_equal_but_for_rounding, labelled, scenes[info.scenes.start : info.scenes.stop])):
            raise DvrError(f"{info.path} holds other scenes than {options.scenes}; choose another --out.")
    covered = {index for info in done for index in info.scenes}
    todo = [
        (first, stop)
        for first in range(0, len(scenes), options.shard)
        for stop in [min(first + options.shard, len(scenes))]
        if not covered.issuperset(range(first, stop))
    ]
    for first, stop in todo:
        if covered.intersection(range(first, stop)):
            raise DvrError(f"--shard is {options.shard}; scenes {first} to {stop - 1} are in shards of another size.")
    tasks = [(scenes[first:stop], first, options.labelling, options.width) for first, stop in todo]
    results = _on_ray(tasks, options.ray) if options.ray else _on_processes(tasks, options.workers)
    begin, count, total = time.monotonic(), 0, sum(stop - first for first, stop in todo)
    for (part, first, *_), labels in results:
        path = options.out / f"labels-{first:06d}.parquet"
        write_shard(path, {first + i: scene for i, scene in enumerate(part)}, labels, footer)
        count += len(part)
        seconds = time.monotonic() - begin
        left = (total - count) * seconds / count
        print(
            f"{len(scenes) - total + count} of {len(scenes)} scenes, {3600 * count / seconds:.0f} an hour, "
            f"{left / 60:.0f} min to go",
            file=sys.stderr,
            flush=True,
        )
    write_manifest(options.out, ["python", "-m", "dvr_jax.sweep", *sys.argv[1:]])


def main() -> int:
    """Read the options, sweep."""
    options = tyro.cli(SweepOptions, prog="python -m dvr_jax.sweep")
    sweep(options)
    print(f"labels written to {options.out}/; `python -m dvr_jax.dataset {options.out}` counts them")
    return 0


if __name__ == "__main__":
    run_command(main)
