"""Lower bounds on the number of actions beside the tree's verdicts: the relaxation must allow what the tree finds.

In sampled scenes, sequences are extended action by action wherever keyframes exist, a random part of them at each
length. No window of such a sequence may be refuted, and the lower bounds of the scene and of all prefixes must be at
most the numbers of actions.
"""

from __future__ import annotations

import random
import sys
from dataclasses import dataclass
from pathlib import Path

import jax
import tyro

from dvr_jax.bench.metrics import Direction, Metric, save_metrics
from dvr_jax.errors import DvrError
from dvr_jax.scene.sampling import scene_of_seed
from dvr_jax.search.node import Node
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import run_alone

LENGTH = 5
"""Largest number of actions."""

WIDTH = 48
"""Largest number of prefixes of one length that are extended."""


@dataclass(frozen=True)
class RelaxationOptions:
    """Compare lower bounds with feasible sequences."""

    number: int = 40
    """Scenes."""
    objects: int = 2
    """Objects in each scene, 1 to 8."""
    seed: int = 6
    """Of the scenes."""
    out: Path | None = None
    """JSON file to write the counts to."""


@dataclass(frozen=True)
class Comparison:
    """Counts of one scene."""

    prefixes: int
    """Sequences with feasible keyframes, whether they reach the goal or not."""

    refuted: int
    """Those of them with a window that the relaxation refutes."""

    leaves: int
    """Those that reach the goal."""

    too_long: int
    """Leaves of which a prefix, or the scene, has a lower bound above the number of actions."""


def run(arguments: list[str]) -> int:
    """Print the counts."""
    options = tyro.cli(RelaxationOptions, prog="python -m dvr_jax.bench relaxation", args=arguments)
    if options.number < 1 or options.seed < 0 or not 1 <= options.objects <= 8:
        raise DvrError(
            f"--number is {options.number}, --seed {options.seed}, --objects {options.objects}; "
            "valid are 1 or more, 0 or more, and 1 to 8."
        )
    found = []
    for index in range(options.number):
        found.append(compare_scene(options.seed, index, options.objects))
        print(f"  scene {index}: {found[-1]}", file=sys.stderr, flush=True)
    prefixes = sum(each.prefixes for each in found)
    refuted = sum(each.refuted for each in found)
    leaves = sum(each.leaves for each in found)
    too_long = sum(each.too_long for each in found)
    print(f"{prefixes} feasible sequences, of which the relaxation refutes {refuted}")
    print(f"{leaves} of them reach the goal; the lower bound is too large for {too_long}")
    if options.out is not None:
        metrics = [
            Metric("feasible sequences", prefixes, "sequences", Direction.HIGHER),
            Metric("refuted by the relaxation", refuted, "sequences", Direction.LOWER),
            Metric("leaves with too large a bound", too_long, "sequences", Direction.LOWER),
        ]
        save_metrics(options.out, "relaxation", metrics)
    return 0


def compare_scene(seed: int, index: int, objects: int) -> Comparison:
    """Compare the relaxation of a scene with the sequence bound.

    Args:
        seed: Seed of the scenes.
        index: Number of the scene.
        objects: Number of objects.
    """
    scene = scene_of_seed(seed, index, objects)
    with jax.enable_x64(True):
        # Two trees, so that no verdict of one helps the other.
        feasible = _feasible_nodes(SequenceTree(scene, LENGTH, is_relaxed=False), index)
        tree = SequenceTree(scene, LENGTH, seed=1)
        run_alone(tree.judge_scene())
        copies = [Node(node.actions, 0, tree.root, node.reaches_goal) for node in feasible]
        passed = run_alone(tree.judge_windows(copies))
        leaves = [node for node in feasible if node.reaches_goal]
        return Comparison(
            prefixes=len(feasible),
            refuted=passed.count(False),
            leaves=len(leaves),
            too_long=sum(_is_bound_too_large(tree, leaf) for leaf in leaves),
        )


def _feasible_nodes(tree: SequenceTree, index: int) -> list[Node]:
    """Return sequences with feasible keyframes of each length, drawn at random."""
    generator = random.Random(index)
    level = [tree.root]
    found: list[Node] = []
    for _ in range(LENGTH):
        children = [child for node in level for child in tree.expand(node)]
        children = generator.sample(children, min(4 * WIDTH, len(children)))
        run_alone(tree.judge_sequences(children))
        passed = [node for node in children if node.feasible]
        found += passed
        inner = [node for node in passed if not node.reaches_goal]
        level = generator.sample(inner, min(WIDTH, len(inner)))
    return found


def _is_bound_too_large(tree: SequenceTree, leaf: Node) -> bool:
    """Return whether the lower bound of the scene, or of a prefix, contradicts a feasible leaf."""
    if tree.relaxation.lower_bound > leaf.depth:
        return True
    return any(
        tree.relaxation.remaining(leaf.actions[:depth]) > leaf.depth - depth
        for depth in range(leaf.depth)
    )
