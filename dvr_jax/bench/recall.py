"""Recall of the solver against an oracle of many random starts, on a frozen set of problems.

`oracle` draws the problems and finds out, at great expense, which of them are feasible; `recall` solves them as a
search does. A keyframe problem is a prefix whose parent the oracle found feasible, and one more action: what a search
asks. A path problem is a sequence with feasible keyframes that reaches the goal."""

from __future__ import annotations

import json
import math
import os
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from numpy.typing import NDArray

from dvr_jax.checker import CheckReport, describe
from dvr_jax.checker.replay import check_motion
from dvr_jax.errors import DvrError
from dvr_jax.logic import Action, Grounding, ground_actions
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.transcription import refute, transcribe
from dvr_jax.planning.feasibility import motion_of
from dvr_jax.runtime.files import write_whole
from dvr_jax.runtime.processes import worker_processes
from dvr_jax.scene.files import scene_from_json, scene_to_json
from dvr_jax.scene.sampling import sample_scene
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.run import Run
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps, run_alone, run_together
from dvr_jax.seeds.initial_paths import path_problem, path_start
from dvr_jax.seeds.proposals import PITCH_RANGE
from dvr_jax.solver.augmented_lagrangian import Settings
from dvr_jax.solver.engine import NlpSolution, solve
from dvr_jax.workcell.constants import TABLE_HALF_EXTENTS
from dvr_jax.workcell.kinematics import load_arm

PROBLEMS = Path(__file__).parent / "problems.jsonl"

STARTS = 64
"""Starts of the oracle."""

ORACLE = Settings(iteration_limit=100, patience=8, course_ratio=math.inf)
"""The oracle's settings: more patient than those of a search."""

TRIES = 40
"""Actions tried to extend a prefix before another scene is drawn."""

BUMP = 0.4
"""Size of the random detour of the oracle's paths [rad]."""

WIDTH = 24
"""Prefixes judged at each depth on the way to a sequence with feasible keyframes."""

KEPT = 6
"""Feasible ones of these that are extended."""

Floats = NDArray[np.float64]


def random_keyframes(problem: Problem, generator: np.random.Generator) -> Variables:
    """Joint angles near home or anywhere within the limits, mode parameters anywhere within their bounds."""
    K = len(problem.is_grasp)
    lower, upper = np.tile(load_arm().joint_limits, 2)
    near = problem.home + generator.normal(size=(K, 14)) * 0.5
    anywhere = generator.uniform(0.9 * lower + 0.1 * upper, 0.1 * lower + 0.9 * upper, (K, 14))
    q = np.clip(near if generator.random() < 0.5 else anywhere, lower, upper)
    half_x, half_y = TABLE_HALF_EXTENTS
    m = np.zeros((K, 4))
    for k in range(K):
        if problem.is_grasp[k] > 0:
            widest = np.array([1.0, 1.0, PITCH_RANGE, math.pi])
            m[k] = generator.uniform(np.maximum(problem.lower[k], -widest), np.minimum(problem.upper[k], widest))
            continue
        x, y, yaw, side, front = problem.support[k]
        spread = generator.uniform(-1, 1, 2) * (min(side, half_x), min(front, half_y)) * 0.8
        c, s = math.cos(yaw), math.sin(yaw)
        m[k, :2] = x + c * spread[0] - s * spread[1], y + s * spread[0] + c * spread[1]
        m[k, 2] = generator.uniform(-math.pi, math.pi)
    return Variables(jnp.asarray(q), jnp.asarray(m))


def oracle_keyframes(
    scene: Scene,
    actions: Sequence[Action],
    generator: np.random.Generator,
    enough: int = 1,
) -> list[NlpSolution]:
    """Feasible keyframes from random starts; stops when there are ``enough``."""
    problem = transcribe(scene, actions)
    found: list[NlpSolution] = []
    piece = 16
    for _ in range(STARTS // piece):
        starts = [random_keyframes(problem, generator) for _ in range(piece)]
        found += [result for result in solve([problem] * piece, starts, ORACLE) if result.feasible]
        if len(found) >= enough:
            break
    return found


def oracle_path(
    problem: Problem,
    keyframes: Sequence[NlpSolution],
    generator: np.random.Generator,
    accept: Callable[[NlpSolution], bool] = lambda path: True,
) -> bool:
    """Whether any of many paths through feasible keyframes, each with a random detour in every phase, can be made
    feasible, and is accepted."""
    for number in range(STARTS):
        chosen = keyframes[number % len(keyframes)]
        start = path_start(problem, Variables(jnp.asarray(chosen.q), jnp.asarray(chosen.m)))
        K, T = len(chosen.m), len(start.q)
        tau = (np.arange(T) % (T // K) + 1) / (T // K)
        bump = np.repeat(generator.normal(size=(K, 14)) * BUMP * (number >= len(keyframes)), T // K, axis=0)
        start = start._replace(q=start.q + bump * np.sin(np.pi * tau)[:, None] ** 2)
        (path,) = solve([path_problem(problem, start)], [start], ORACLE)
        if path.feasible and accept(path):
            return True
    return False


def random_extension(
    grounding: Grounding, scene: Scene, state: int, keep: Callable[[int], bool], generator: np.random.Generator
) -> tuple[Action, int] | None:
    """An applicable action that no constant of the scene refutes, and the state after it."""
    for index in generator.permutation(list(grounding.applicable(state))):
        action, after = grounding.actions[index], grounding.successor(state, int(index))
        if keep(after) and refute(scene, action) is None:
            return action, after
    return None


def draw_keyframe_problem(seed: int, index: int, length: int) -> dict[str, object]:
    """A prefix whose parent is feasible, with the oracle's verdict."""
    generator = np.random.default_rng([seed, index])
    while True:
        scene = sample_scene(generator, 2)
        grounding = ground_actions([item.name for item in scene.objects], scene.goal.object)
        actions: list[Action] = []
        state, tries = grounding.initial_state, 0
        while tries < TRIES:
            tries += 1
            last = len(actions) == length - 1
            step = random_extension(grounding, scene, state, lambda after: True, generator)
            if step is not None and not last and grounding.is_goal(step[1]):
                continue
            if step is None:
                break
            found = oracle_keyframes(scene, [*actions, step[0]], generator)
            if last:
                return _row(scene, [*actions, step[0]], bool(found))
            if found:
                actions, state = [*actions, step[0]], step[1]


def find_sequences(tree: SequenceTree, length: int, number: int, generator: np.random.Generator) -> list[Node]:
    """Some sequences of a length whose keyframes the tree finds feasible."""
    nodes = [tree.root]
    for left in range(length - 1, -1, -1):
        children = [
            child for node in nodes for child in tree.expand(node) if tree.grounding.reaches_goal_in(child.state, left)
        ]
        chosen = [children[i] for i in generator.permutation(len(children))[:WIDTH]]
        run_alone(tree.judge_sequences(chosen))
        nodes = [node for node in chosen if node.feasible][: KEPT if left else number]
    return nodes


def draw_path_problem(seed: int, index: int, length: int) -> dict[str, object]:
    """A sequence that reaches the goal and whose keyframes are feasible by our verdict and by the oracle's, with the
    oracle's verdict on its path. (Drawn action by action, a sequence of six hardly ever has feasible keyframes.)"""
    generator = np.random.default_rng([seed, 1, index])
    while True:
        scene = sample_scene(generator, 2)
        for node in find_sequences(SequenceTree(scene, length), length, 1, generator):
            keyframes = oracle_keyframes(scene, node.actions, generator, enough=8)
            if keyframes:
                feasible = oracle_path(transcribe(scene, node.actions), keyframes, generator)
                return _row(scene, node.actions, feasible)


def _row(scene: Scene, actions: Sequence[Action], feasible: bool) -> dict[str, object]:
    return {
        "length": len(actions),
        "feasible": feasible,
        "actions": [[action.operator, *action.arguments] for action in actions],
        "scene": json.loads(scene_to_json(scene)),
    }


@dataclass(frozen=True)
class OracleOptions:
    """Draw problems and find the feasible ones by 64 random starts each."""

    keyframes: int = 300
    """Keyframe problems, of lengths 1 to 6 in turn."""
    paths: int = 100
    """Path problems, of lengths 2 to 6 in turn."""
    seed: int = 900
    """Of everything."""
    out: Path = PROBLEMS
    """JSON Lines file; problems that it already has are kept."""
    workers: int = os.cpu_count() or 1
    """Processes, one problem each at a time."""


def _draw_problem(seed: int, kind: str, index: int, length: int) -> dict[str, object]:
    """One row of the problem file."""
    draw = draw_keyframe_problem if kind == "keyframes" else draw_path_problem
    with jax.enable_x64(True):
        return {"kind": kind, "index": index, **draw(seed, index, length)}


def run_oracle(arguments: list[str]) -> int:
    """Draw the problem set."""
    options = tyro.cli(OracleOptions, prog="python -m dvr_jax.bench oracle", args=arguments)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rows = _read_rows(options.out) if options.out.exists() else []
    done = {(row["kind"], row["index"]) for row in rows}
    write_whole(options.out, "".join(json.dumps(row) + "\n" for row in rows).encode())
    jobs = [("keyframes", index, 1 + index % 6) for index in range(options.keyframes)]
    jobs += [("path", index, 2 + index % 5) for index in range(options.paths)]
    todo = [job for job in jobs if job[:2] not in done]
    with options.out.open("a", encoding="utf-8") as file, worker_processes(options.workers) as pool:
        draw = partial(_draw_problem, options.seed)
        for future in as_completed([pool.submit(draw, *job) for job in todo]):
            row = future.result()
            file.write(json.dumps(row) + "\n")
            file.flush()
            verdict = "feasible" if row["feasible"] else "infeasible"
            print(f"  {row['kind']} {row['index']}: length {row['length']}, {verdict}", file=sys.stderr, flush=True)
    return 0


@dataclass(frozen=True)
class RecallOptions:
    """Solve the oracle's problems as a search does, and compare the verdicts."""

    problems: Path = PROBLEMS
    """What `python -m dvr_jax.bench oracle` wrote."""


def _read_rows(path: Path) -> list[dict[str, Any]]:
    """ConstraintValues by kind and index; a last line that was cut short is dropped."""
    text = path.read_text(encoding="utf-8")
    try:
        rows = [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]
        return sorted(rows, key=lambda row: (row["kind"], row["index"]))
    except (ValueError, LookupError, TypeError) as error:
        raise DvrError(f"{path} holds no problems ({error}); valid is what bench oracle writes.") from None


def read_problems(path: Path) -> Iterator[tuple[Scene, list[Action], dict[str, Any]]]:
    """Scene, actions and row of each problem, in a fixed order."""
    if not path.exists():
        raise DvrError(f"there is no file {path}; the repository has it, seen from its root.")
    for row in _read_rows(path):
        actions = [Action(operator, tuple(arguments)) for operator, *arguments in row["actions"]]
        yield scene_from_json(json.dumps(row["scene"])), actions, row


def judge_prefix(tree: SequenceTree, actions: Sequence[Action], second_look: bool = False) -> Steps[Node]:
    """The node of a sequence, with the sequence bound of each of its prefixes, and the second look that searches take
    at a sequence that reaches the goal."""
    node = tree.root
    for k in range(len(actions)):
        child = Node(tuple(actions[: k + 1]), 0, node, reaches_goal=False)
        if node.feasible:
            yield from tree.judge_sequences([child])
            if second_look:
                yield from tree.retry_refuted([child])
        else:
            child.feasible = False
        node = child
    return node


def _judge(scene: Scene, actions: Sequence[Action], is_path: bool) -> Steps[tuple[bool, CheckReport | None]]:
    """Our verdict on a problem, and what the check says of its first feasible path (None: there is no path)."""
    tree = SequenceTree(scene, k_max=6)
    node = yield from judge_prefix(tree, actions, second_look=True)
    if not (is_path and node.feasible):
        return bool(node.feasible) and not is_path, None
    reports: list[CheckReport] = []

    def accept(leaf: Node, path: NlpSolution) -> bool:
        reports.append(check_motion(scene, leaf.actions, motion_of(scene, leaf, path)))
        return True

    found = yield from Run(tree, accept, lambda line: None).try_path(node)
    return found is not None, reports[0] if reports else None


def run(arguments: list[str]) -> int:
    """Print recall by kind and length."""
    options = tyro.cli(RecallOptions, prog="python -m dvr_jax.bench recall", args=arguments)
    table: dict[tuple[str, int], list[tuple[bool, bool]]] = defaultdict(list)
    checked: list[bool] = []
    problems = list(read_problems(options.problems))
    with jax.enable_x64(True):
        judged = run_together([_judge(scene, actions, row["kind"] == "path") for scene, actions, row in problems])
        verdicts = dict(judged)
    for number, (_, actions, row) in enumerate(problems):
        ours, report = verdicts[number]
        words = f"{row['kind']} {number}: {' '.join(map(str, actions))}"
        if report is not None:
            checked.append(report.passed)
            if not report.passed:
                print(f"  {words}: {describe(report)}", file=sys.stderr)
        if ours != row["feasible"]:
            print(f"  {words}: oracle {row['feasible']}, ours {ours}", file=sys.stderr)
        table[str(row["kind"]), int(row["length"])].append((bool(row["feasible"]), ours))
    print("            problems   feasible: oracle   ours   both   recall   found by ours alone")
    for kind in ("keyframes", "path"):
        of_kind = {length: pairs for (k, length), pairs in table.items() if k == kind}
        for length, pairs in sorted(of_kind.items()):
            _print_line(f"{kind} {length}", pairs)
        if of_kind:
            _print_line(f"{kind} all", [pair for pairs in of_kind.values() for pair in pairs])
    if checked:
        print(f"feasible paths that pass the independent check: {sum(checked)} of {len(checked)}")
    return 0


def _print_line(name: str, pairs: list[tuple[bool, bool]]) -> None:
    oracle, ours = sum(a for a, _ in pairs), sum(b for _, b in pairs)
    both = sum(a and b for a, b in pairs)
    recall = f"{both / oracle:7.1%}" if oracle else "      -"
    print(f"{name:<14} {len(pairs):>6} {oracle:>18} {ours:>6} {both:>6}  {recall} {ours - both:>21}")
