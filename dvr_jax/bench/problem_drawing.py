"""Random problems of the benchmarks, each with the oracle's verdict: what `python -m dvr_jax.bench oracle` writes."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import numpy as np
import tyro

from dvr_jax.bench.oracle import oracle_keyframes, oracle_path
from dvr_jax.bench.problems import PROBLEMS, read_rows
from dvr_jax.logic import Action, Grounding
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.operators import OPERATORS, ground_scene, refute
from dvr_jax.runtime.files import append_line, write_whole
from dvr_jax.runtime.processes import worker_processes
from dvr_jax.scene.files import scene_to_json
from dvr_jax.scene.sampling import sample_scene
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import run_alone
from dvr_jax.workcell.model import workcell_model

TRIES = 40
"""Actions tried to extend a prefix before another scene is drawn."""

WIDTH = 24
"""Prefixes judged at each depth on the way to a sequence with feasible keyframes."""

KEPT = 6
"""Feasible ones of these that are extended."""

FEASIBLE_KEYFRAMES = 8
"""Feasible keyframes from which the oracle starts its paths."""


@dataclass(frozen=True)
class OracleOptions:
    """Draw problems and find the feasible ones by 64 random starts each."""

    keyframes: int = 300
    """Keyframe problems, of lengths 1 to 6 in turn."""
    paths: int = 100
    """Path problems, of lengths 2 to 6 in turn."""
    seed: int = 900
    """Of everything."""
    out: Path = Path(str(PROBLEMS))
    """JSON Lines file; problems that it already has are kept. By default that of the package."""
    workers: int = os.cpu_count() or 1
    """Processes, one problem each at a time."""


def run(arguments: list[str]) -> int:
    """Draw the problem set."""
    options = tyro.cli(OracleOptions, prog="python -m dvr_jax.bench oracle", args=arguments)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rows = read_rows(options.out) if options.out.exists() else []
    done = {(row["kind"], row["index"]) for row in rows}

    # A last line that was cut short is dropped from the file, too.
    write_whole(options.out, "".join(json.dumps(row) + "\n" for row in rows).encode())

    jobs = [("keyframes", index, 1 + index % 6) for index in range(options.keyframes)]
    jobs += [("path", index, 2 + index % 5) for index in range(options.paths)]
    todo = [(kind, index, length) for kind, index, length in jobs if (kind, index) not in done]

    with worker_processes(options.workers) as pool:
        draw = partial(_draw_problem, options.seed)
        futures = [pool.submit(draw, *job) for job in todo]
        for future in as_completed(futures):
            row = future.result()
            append_line(options.out, json.dumps(row) + "\n")
            verdict = "feasible" if row["feasible"] else "infeasible"
            print(
                f"  {row['kind']} {row['index']}: length {row['length']}, {verdict}",
                file=sys.stderr,
                flush=True,
            )
    return 0


def _draw_problem(seed: int, kind: str, index: int, length: int) -> dict[str, object]:
    """Give one row of the problem file."""
    draw = draw_keyframe_problem if kind == "keyframes" else draw_path_problem
    with jax.enable_x64(True):
        return {"kind": kind, "index": index, **draw(seed, index, length)}


def random_extension(
    grounding: Grounding,
    scene: Scene,
    state: int,
    keep: Callable[[int], bool],
    generator: np.random.Generator,
) -> tuple[Action, int] | None:
    """Draw an applicable action that no constant of the scene refutes.

    Args:
        grounding: the scene's actions.
        scene: the scene.
        state: symbolic state that the action starts from.
        keep: says whether the state after an action is wanted.
        generator: of the draw.

    Returns:
        The action and the state after it; None where there is no such action.
    """
    for index in generator.permutation(list(grounding.applicable(state))):
        action = grounding.actions[index]
        after = grounding.successor(state, int(index))
        if keep(after) and refute(scene, action, OPERATORS) is None:
            return action, after
    return None


def draw_keyframe_problem(seed: int, index: int, length: int) -> dict[str, object]:
    """Draw a prefix whose parent is feasible, with the oracle's verdict.

    Args:
        seed: of the problem set.
        index: number of the problem in the set.
        length: number of actions of the prefix.

    Returns:
        The row of the problem file, without kind and index.
    """
    generator = np.random.default_rng([seed, index])
    while True:
        scene = sample_scene(generator, 2)
        row = _draw_prefix(scene, length, generator)
        if row is not None:
            return row


def _draw_prefix(
    scene: Scene, length: int, generator: np.random.Generator
) -> dict[str, object] | None:
    """Extend a prefix by random feasible actions up to a length; None after `TRIES` actions, or at a dead end."""
    grounding = ground_scene(scene)
    actions: list[Action] = []
    state = grounding.initial_state

    for _ in range(TRIES):
        extension = random_extension(grounding, scene, state, lambda after: True, generator)
        if extension is None:
            return None
        action, after = extension

        # A sequence ends when the goal first holds, so that only a last action may reach it.
        is_last = len(actions) == length - 1
        if not is_last and grounding.is_goal(after):
            continue

        found = oracle_keyframes(scene, [*actions, action], generator)
        if is_last:
            return _row(scene, [*actions, action], bool(found))
        if found:
            actions.append(action)
            state = after
    return None


def find_sequences(
    tree: SequenceTree, length: int, number: int, generator: np.random.Generator
) -> list[Node]:
    """Find some sequences of a length that reach the goal and whose keyframes the tree finds feasible.

    Args:
        tree: the tree of the scene's sequences.
        length: number of actions.
        number: at most so many sequences.
        generator: of the draw.

    Returns:
        Their nodes.
    """
    nodes = [tree.root]
    for left in range(length - 1, -1, -1):
        expanded = [child for node in nodes for child in tree.expand(node)]
        children = [
            child for child in expanded if tree.grounding.reaches_goal_in(child.state, left)
        ]
        chosen = [children[i] for i in generator.permutation(len(children))[:WIDTH]]
        run_alone(tree.judge_sequences(chosen))

        feasible = [node for node in chosen if node.feasible]
        nodes = feasible[: KEPT if left else number]
    return nodes


def draw_path_problem(seed: int, index: int, length: int) -> dict[str, object]:
    """Draw a sequence that reaches the goal and has feasible keyframes, with the oracle's verdict on its path.

    The keyframes are feasible by our verdict and by the oracle's. Ours comes first because a sequence of six actions
    that is drawn action by action hardly ever has feasible keyframes.

    Args:
        seed: of the problem set.
        index: number of the problem in the set.
        length: number of actions of the sequence.

    Returns:
        The row of the problem file, without kind and index.
    """
    generator = np.random.default_rng([seed, 1, index])
    while True:
        scene = sample_scene(generator, 2)
        for node in find_sequences(SequenceTree(scene, length), length, 1, generator):
            keyframes = oracle_keyframes(scene, node.actions, generator, FEASIBLE_KEYFRAMES)
            if keyframes:
                feasible = oracle_path(
                    workcell_model(scene.workcell),
                    transcribe(scene, node.actions),
                    keyframes,
                    generator,
                )
                return _row(scene, node.actions, feasible)


def _row(scene: Scene, actions: Sequence[Action], feasible: bool) -> dict[str, object]:
    return {
        "length": len(actions),
        "feasible": feasible,
        "actions": [[action.operator, *action.arguments] for action in actions],
        "scene": json.loads(scene_to_json(scene)),
    }
