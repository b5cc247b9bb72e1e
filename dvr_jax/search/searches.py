"""Breadth-first search and multi-bound tree search over the sequences of one scene, and all searches by name.

These two visit sequences in order of length and stop at the first whose path is accepted; both are complete up to
K_max: they end without a solution only when every sequence has been refuted by some bound (or at the time limit).
Within a length, sequences that reach the goal come first. They differ in what they compute on the way:

- *breadth-first* takes the sequence bound of every prefix;
- *multi-bound* (Toussaint and Lopes 2017) prunes with the pose bound, whose verdicts many prefixes share, and takes
  the sequence bound along the sequences that reach the goal only, with a second look at what it refutes there.
"""

from __future__ import annotations

from collections.abc import Callable

from dvr_jax.errors import DvrError
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import OutOfTime
from dvr_jax.search.reasoning import Network, feasibility_classifier, visual_reasoning
from dvr_jax.search.run import Accept, Outcome, Progress, Run
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps, run_alone

LEAVES = 64
"""Leaves judged before paths of the feasible ones are tried."""

EAGER = 3
"""Length up to which multi-bound search takes the pose bound of all prefixes."""

_Judge = Callable[[list[Node]], Steps[list[Node]]]


def _batches(nodes: list[Node]) -> list[list[Node]]:
    return [nodes[i : i + LEAVES] for i in range(0, len(nodes), LEAVES)]


def _search(run: Run, of_leaves: _Judge, judge: _Judge) -> Steps[Outcome]:
    """Level by level: ``of_leaves`` gives the leaves whose paths are tried, ``judge`` the prefixes to go on from."""
    level = [run.tree.root]
    for depth in range(1, run.tree.k_max + 1):
        children = [child for node in level if node.feasible is not False for child in run.tree.expand(node)]
        leaves = [node for node in children if node.reaches_goal]
        run.progress(f"length {depth}: {len(children)} prefixes, {len(leaves)} reach the goal")
        for batch in _batches(run.arrange(leaves)):
            run.tree.counts.verdicts["leaf"] += len(batch)
            feasible = yield from of_leaves(batch)
            outcome = yield from run.try_leaves(feasible)
            if outcome is not None:
                return outcome
        if depth < run.tree.k_max:
            level = yield from judge([node for node in children if not node.reaches_goal])
    return Outcome(PlanStatus.EXHAUSTED, None, None, run.seconds)


def breadth_first(run: Run) -> Steps[Outcome]:
    """Plain breadth-first search: the sequence bound of every prefix, level by level."""
    return (yield from _search(run, run.judge_sequences, run.judge_sequences))


def multi_bound(run: Run) -> Steps[Outcome]:
    """Multi-bound tree search: the pose bound prunes, the sequence bound is taken along goal-reaching sequences.

    Pose bounds of short prefixes are taken at once; those of longer ones, which are many, only along the sequences
    whose turn it is, or where a shorter one has refuted them already."""

    def judge(nodes: list[Node]) -> Steps[list[Node]]:
        if nodes and nodes[0].depth <= EAGER:
            return (yield from run.judge_poses(nodes))
        return [node for node in nodes if run.tree.check_cached_pose_bound(node)]

    return (yield from _search(run, run.judge_leaves, judge))


BLIND: dict[str, Callable[[Run], Steps[Outcome]]] = {"mbts": multi_bound, "bfs": breadth_first}
"""Searches that need no network, by the name that the command line gives them."""

GUIDED: dict[str, Callable[[Run, Network], Steps[Outcome]]] = {
    "dvr": visual_reasoning,
    "classifier": feasibility_classifier,
}
"""Searches that a network of the same kind guides."""

SEARCHES = (*GUIDED, *BLIND)


def search(
    name: str, tree: SequenceTree, accept: Accept, progress: Progress, network: Network | None = None
) -> Outcome:
    """Run a search until it finds something, has seen everything, or the tree's time is over."""
    run = Run(tree, accept, progress)
    try:
        return run_alone(steps_of(name, run, network))
    except OutOfTime:
        return Outcome(PlanStatus.TIME_LIMIT, None, None, run.seconds)


def steps_of(name: str, run: Run, network: Network | None = None) -> Steps[Outcome]:
    """A search by its name, ready to be run."""
    if name in BLIND:
        return BLIND[name](run)
    if name not in GUIDED:
        raise DvrError(f"there is no search '{name}'; valid: {', '.join(SEARCHES)}.")
    if network is None:
        raise DvrError(f"the search '{name}' needs a network; valid without one: {', '.join(BLIND)}.")
    return GUIDED[name](run, network)
