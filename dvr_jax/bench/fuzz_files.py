"""Damaged files of every kind that the package writes: refused in one sentence that names them, or read the same.

A cache entry is not refused but passed over, which counts as refused here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
import optax

from dvr_jax.bench.fuzz_damage import damage
from dvr_jax.bench.fuzz_judge import Problem, Tally, judge
from dvr_jax.dataset.labels import Label
from dvr_jax.dataset.shards import find_shards, read_shard, same_rows, write_shard
from dvr_jax.errors import DvrError
from dvr_jax.model.checkpoint import CheckpointFolder, TrainingState
from dvr_jax.model.export import export_network, load_parameters
from dvr_jax.model.history import History, read_history
from dvr_jax.model.metadata import NetworkMetadata
from dvr_jax.model.network import initial_parameters
from dvr_jax.model.network_config import NetworkConfig
from dvr_jax.motion.file import load_motion, save_motion
from dvr_jax.operators import OPERATORS, ground_scene
from dvr_jax.planning.goal_met import resting_motion, resting_plan
from dvr_jax.planning.result import Plan
from dvr_jax.runtime.program_files import read_entry, write_entry
from dvr_jax.scene.files import load_scenes, save_scenes
from dvr_jax.scene.random_scenes import sample_scenes
from dvr_jax.scene.types import Scene
from dvr_jax.scene.validation import make_scene

SMALL = NetworkConfig(image_size=16, channels=(1, 2, 2), dense=4, hidden=5)
"""Sizes of the network; those of a trained one would only take longer."""


@dataclass(frozen=True, slots=True)
class FileKind:
    """One kind of files, with an intact example."""

    name: str
    """What it is."""

    files: tuple[Path, ...]
    """The files that are damaged, one at a time."""

    read: Callable[[], Any]
    """Reads the example."""

    equal: Callable[[Any, Any], bool]
    """Whether what was read is what the intact example holds."""


def fuzz_files(number: int, seed: int, folder: Path, tallies: dict[str, Tally]) -> list[Problem]:
    """Damage and read files, each kind in turn.

    Args:
        number: Number of damaged files.
        seed: Seed of the damage.
        folder: Empty folder for the files.
        tallies: Takes the cases, by kind.

    Returns:
        The cases that ended as none may.
    """
    kinds = make_files(folder)
    intact = [kind.read() for kind in kinds]
    problems = []

    for index in range(number):
        kind = kinds[index % len(kinds)]
        generator = np.random.default_rng([seed, 2, index])
        tally = tallies.setdefault(kind.name, Tally())
        wrong = _damage_and_read(kind, intact[index % len(kinds)], generator, tally)
        if wrong is not None:
            problems.append(Problem(kind.name, index, wrong))

    return problems


def make_files(folder: Path) -> list[FileKind]:
    """Write an example of each kind of files, and return the kinds."""
    scenes = tuple(sample_scenes(3, 2, 5))
    return [
        _scenes(folder / "scenes.jsonl", scenes),
        _motion(folder / "trajectory.npz", scenes[0]),
        _plan(folder / "plan", scenes[0]),
        _network(folder / "network.npz"),
        _checkpoint(folder / "checkpoints"),
        _history(folder / "training"),
        _shard(folder / "labels-000000.parquet", scenes),
        _program(folder / "cache" / "programs-1" / "dvr_jax.a.executable"),
    ]


def _damage_and_read(
    kind: FileKind, intact: Any, generator: np.random.Generator, tally: Tally
) -> str | None:
    """Damage one file of an example, read the example, and put the file back as it was."""
    path = kind.files[generator.integers(len(kind.files))]
    whole = path.read_bytes()
    path.write_bytes(damage(whole, generator))

    def read() -> str | None:
        found = kind.read()
        if found is None:
            raise DvrError(f"{path.name} is passed over.")
        return None if kind.equal(found, intact) else f"{path.name} is accepted and differs"

    try:
        return judge(read, path.name if len(kind.files) == 1 else kind.files[0].parts[-2], tally)
    finally:
        path.write_bytes(whole)


def _scenes(path: Path, scenes: tuple[Scene, ...]) -> FileKind:
    """A scene has no checksum, because people write it; that it is valid is tested with single scenes."""
    save_scenes(path, scenes)
    return FileKind("file of scenes", (path,), lambda: load_scenes(path), lambda *_: True)


def _motion(path: Path, scene: Scene) -> FileKind:
    save_motion(path, resting_motion(scene))

    def equal(one: Any, other: Any) -> bool:
        return all(
            np.array_equal(getattr(one, name), getattr(other, name))
            for name in ("time", "qpos", "switch")
        )

    return FileKind("trajectory", (path,), lambda: load_motion(path), equal)


def _plan(folder: Path, scene: Scene) -> FileKind:
    """The plan of a scene whose goal holds from the start."""
    from dvr_jax.checker import CHECKS
    from dvr_jax.goals import OnRegion, Region

    item = scene.objects[0]
    region = Region(item.position, item.yaw, (0.3, 0.3))
    met = make_scene(scene.objects, OnRegion(item.name, region))
    plan = resting_plan(met, OPERATORS, CHECKS, {"search": "mbts"})
    assert plan is not None
    plan.save(folder, pictures=False, animation=False)
    return FileKind(
        "plan", (folder / "plan.json",), lambda: Plan.load(folder), lambda one, two: one == two
    )


def _network(path: Path) -> FileKind:
    export_network(path, initial_parameters(SMALL, 1), NetworkMetadata("dvr", SMALL))
    return FileKind("network", (path,), lambda: load_parameters(path), _same_network)


def _checkpoint(folder: Path) -> FileKind:
    """Two equal checkpoints, of which the files of the latest one are damaged."""
    parameters = initial_parameters(SMALL, 1)
    optimizer = optax.scale_by_adam().init(parameters.tree)
    checkpoints = CheckpointFolder(folder)
    for step in (5, 9):
        state = TrainingState(parameters, optimizer, step, seed=0)
        checkpoints.save(state, NetworkMetadata("dvr", SMALL))
    checkpoints.close()

    files = sorted(path for path in (folder / "9").rglob("*") if path.is_file())
    return FileKind("checkpoint", tuple(files), lambda: load_parameters(folder), _same_network)


def _same_network(one: Any, other: Any) -> bool:
    leaves = zip(jax.tree.leaves(one[0]), jax.tree.leaves(other[0]), strict=True)
    return one[1] == other[1] and all(np.array_equal(mine, theirs) for mine, theirs in leaves)


def _history(folder: Path) -> FileKind:
    with History(folder, 0) as history:
        for step in range(10, 60, 10):
            history.add(step, "train", {"loss": 1 / step})
    path = folder / "history.jsonl"

    def equal(one: Any, other: Any) -> bool:
        # A last line that was cut short is left out, as after a kill.
        return bool(one == other[: len(one)])

    return FileKind("history", (path,), lambda: read_history(path), equal)


def _shard(path: Path, scenes: tuple[Scene, ...]) -> FileKind:
    labels = []
    for index, scene in enumerate(scenes):
        for action in ground_scene(scene).actions:
            if action.operator == "grasp":
                labels.append(Label(index, (str(action),), False, True, "pose", 3.0))
    write_shard(path, dict(enumerate(scenes)), labels, {"seed": 1})

    def read() -> Any:
        [info] = find_shards(path)
        return read_shard(info.path)

    def equal(one: Any, other: Any) -> bool:
        return one.info.footer == other.info.footer and same_rows(one, other)

    return FileKind("shard", (path,), read, equal)


def _program(path: Path) -> FileKind:
    write_entry(path, bytes(range(256)) * 4)
    return FileKind(
        "compiled program", (path,), lambda: read_entry(path), lambda one, two: one == two
    )
