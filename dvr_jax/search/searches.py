"""Breadth-first search and multi-bound tree search over the sequences of one scene, and all searches by name.

These two visit sequences in order of length and stop at the first whose path is accepted; both are complete up to
K_max: they end without a solution only when every sequence has been refuted by some bound (or at the time limit).
Within a length, sequences that reach the goal come first. They differ in what they compute on the way:

- *breadth-first* takes the sequence bound of every prefix;
- *multi-bound* (Toussaint and Lopes 2017) prunes with the pose bound, whose verdicts many prefixes share, and takes the
  sequence bound along the sequences that reach the goal only, with a second opinion on what it refutes there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from dvr_jax.errors import DvrError
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import OutOfTime
from dvr_jax.search.predictor import Encoding, Images, SequencePredictor
from dvr_jax.search.reasoning import feasibility_classifier, visual_reasoning
from dvr_jax.search.session import Accept, Outcome, Progress, SearchSession
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps, run_alone

LEAVES = 64
"""Leaves judged before paths of the feasible ones are tried."""

EAGER_LENGTH = 3
"""Length up to which multi-bound search takes the pose bound of all prefixes."""

Judge = Callable[[list[Node]], Steps[list[Node]]]
"""Takes a bound of nodes and returns those that pass."""


def breadth_first(session: SearchSession) -> Steps[Outcome]:
    """Search breadth-first: take the sequence bound of every prefix, level by level."""
    return (yield from _by_levels(session, session.judge_sequences, session.judge_sequences))


def multi_bound(session: SearchSession) -> Steps[Outcome]:
    """Search with several bounds: the pose bound prunes, the sequence bound is taken along goal-reaching sequences.

    Pose bounds of short prefixes are taken at once; those of longer ones, which are many, only along the sequences
    whose turn it is, or where a shorter one has refuted them already.
    """

    def judge(nodes: list[Node]) -> Steps[list[Node]]:
        if nodes and nodes[0].depth <= EAGER_LENGTH:
            return (yield from session.judge_poses(nodes))
        return [node for node in nodes if session.tree.check_cached_pose_bound(node)]

    return (yield from _by_levels(session, session.judge_leaves, judge))


def _by_levels(
    session: SearchSession, judge_leaves: Judge, judge_prefixes: Judge
) -> Steps[Outcome]:
    """Search level by level.

    Args:
        session: The search under way.
        judge_leaves: Gives the leaves whose paths are tried.
        judge_prefixes: Gives the prefixes to go on from.
    """
    tree = session.tree
    level = [tree.root]
    for depth in range(1, tree.k_max + 1):
        children = [
            child for node in level if node.feasible is not False for child in tree.expand(node)
        ]
        leaves = [node for node in children if node.reaches_goal]
        session.progress(f"length {depth}: {len(children)} prefixes, {len(leaves)} reach the goal")

        for batch in _batches(session.arrange(leaves)):
            tree.counts.verdicts["leaf"] += len(batch)
            feasible = yield from judge_leaves(batch)
            outcome = yield from session.try_leaves(feasible)
            if outcome is not None:
                return outcome

        if depth < tree.k_max:
            level = yield from judge_prefixes([node for node in children if not node.reaches_goal])
    return Outcome(PlanStatus.EXHAUSTED, seconds=session.seconds)


def _batches(nodes: list[Node]) -> list[list[Node]]:
    return [nodes[first : first + LEAVES] for first in range(0, len(nodes), LEAVES)]


BLIND: dict[str, Callable[[SearchSession], Steps[Outcome]]] = {
    "mbts": multi_bound,
    "bfs": breadth_first,
}
"""Searches that need no network, by the name that the command line gives them."""


class GuidedSearch(Protocol):
    """A search that takes any network."""

    def __call__(
        self, session: SearchSession, network: SequencePredictor[Images, Encoding]
    ) -> Steps[Outcome]:
        """Search with the network's predictions."""
        ...


GUIDED: dict[str, GuidedSearch] = {
    "dvr": visual_reasoning,
    "classifier": feasibility_classifier,
}
"""Searches that a network of the same kind guides."""

SEARCHES = (*GUIDED, *BLIND)
"""Names of all searches."""


def search(
    name: str,
    tree: SequenceTree,
    accept: Accept,
    progress: Progress,
    network: SequencePredictor[Images, Encoding] | None = None,
) -> Outcome:
    """Run a search until it finds something, has seen everything, or the tree's time is over.

    Args:
        name: Name of the search.
        tree: Sequences of the scene.
        accept: Says of a feasible path whether the independent check accepts it.
        progress: Takes lines that say what is going on.
        network: Of the search's kind, where it needs one.
    """
    session = SearchSession(tree, accept, progress)
    try:
        return run_alone(steps_of(name, session, network))
    except OutOfTime:
        return Outcome(PlanStatus.TIME_LIMIT, seconds=session.seconds)


def steps_of(
    name: str, session: SearchSession, network: SequencePredictor[Images, Encoding] | None = None
) -> Steps[Outcome]:
    """A search by its name, ready to be run.

    Args:
        name: Name of the search.
        session: The search under way.
        network: Of the search's kind, where it needs one.

    Raises:
        DvrError: There is no search of this name, or it needs a network.
    """
    if name in BLIND:
        return BLIND[name](session)
    if name not in GUIDED:
        raise DvrError(f"there is no search '{name}'; valid: {', '.join(SEARCHES)}.")
    if network is None:
        raise DvrError(
            f"the search '{name}' needs a network; valid without one: {', '.join(BLIND)}."
        )
    return GUIDED[name](session, network)
