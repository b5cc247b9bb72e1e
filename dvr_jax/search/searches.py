"""Breadth-first search and multi-bound tree search over the sequences of one scene, and all searches by name.

Breadth-first and multi-bound search visit sequences in order of length and stop at the first one whose path is
accepted. Both are complete up to K_max: they end without a solution only when every sequence has been refuted by some
bound (or at the time limit). Among sequences of the same length, those that reach the goal (the *leaves*) come first.
The two searches differ in the bounds that they compute (`dvr_jax.search.tree` defines them):

- *breadth-first* computes the sequence bound of every prefix;
- *multi-bound* (Toussaint and Lopes 2017) prunes with the pose bound, whose verdicts many prefixes share. It computes
  the sequence bound only for leaves and their prefixes, and retries once what this bound refutes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from dvr_jax.errors import DvrError
from dvr_jax.goals import OnRegion
from dvr_jax.scene.types import Scene
from dvr_jax.search.front import Guide, PrefixFront
from dvr_jax.search.goal_guide import GoalGuide
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import OutOfTime
from dvr_jax.search.one_fact import network_for, only_fact
from dvr_jax.search.predictor import Encoding, Images, SequencePredictor
from dvr_jax.search.reasoning import feasibility_classifier, visual_reasoning
from dvr_jax.search.session import Accept, LongerSearch, Outcome, Progress, SearchSession
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Reply, Steps, run_alone, work_of
from dvr_jax.solver.state import Termination

LEAVES = 64
"""Number of leaves whose bounds are computed in one batch before the paths of the feasible ones are tried."""

UNRELAXED_LENGTH = 2
"""Sequences of up to this length are judged before the relaxation is computed, which costs as much as they do."""

EAGER_LENGTH = 3
"""Length up to which multi-bound search computes the pose bound of all prefixes."""

EXPANSIONS_AT_A_TIME = 8
"""Number of prefixes that best-first search expands before it looks whether there are leaves."""

SPARE_ACTIONS = 4
"""By default, a search goes up to the lower bound on the number of actions plus this number."""

LONGER_WORK = 6_000
"""Largest number of slices of all NLPs and beams for sequences of more than the usual number of actions, where the
caller states none."""

Judge = Callable[[list[Node]], Steps[list[Node]]]
"""Function that computes a bound of nodes and returns the nodes that pass."""


def breadth_first(session: SearchSession) -> Steps[Outcome]:
    """Search breadth-first: compute the sequence bound of every prefix, one length after the other."""
    return (yield from _by_levels(session, session.judge_sequences, session.judge_sequences))


def multi_bound(session: SearchSession) -> Steps[Outcome]:
    """Search with several bounds: prune with the pose bound, and compute the sequence bound of leaves only.

    The pose bounds of all short prefixes are computed. There are many longer prefixes, so their pose bounds are
    computed only as part of the leaves that are judged next; otherwise only the verdicts known already are used.
    """

    def judge(nodes: list[Node]) -> Steps[list[Node]]:
        """Compute the pose bounds of short prefixes; look up those of longer ones."""
        if nodes and nodes[0].depth <= EAGER_LENGTH:
            return (yield from session.judge_poses(nodes))
        return [node for node in nodes if session.tree.check_cached_pose_bound(node)]

    return (yield from _by_levels(session, session.judge_leaves, judge))


def _by_levels(
    session: SearchSession, judge_leaves: Judge, judge_prefixes: Judge
) -> Steps[Outcome]:
    """Search all sequences of one length after the other.

    Args:
        session: The search in progress.
        judge_leaves: Returns those of some leaves whose paths are tried.
        judge_prefixes: Returns those of some prefixes that are expanded.
    """
    tree = session.tree
    level = [tree.root]
    for depth in range(1, tree.k_max + 1):
        is_relaxed = depth > UNRELAXED_LENGTH or tree.is_refuted_at_once()
        if is_relaxed and not (yield from session.judge_scene()):
            break
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

    # The relaxation may know a reason, also if it was not needed.
    yield from session.judge_scene()
    return Outcome(PlanStatus.EXHAUSTED, seconds=session.seconds)


def _batches(nodes: list[Node]) -> list[list[Node]]:
    """Divide nodes into batches of at most `LEAVES`."""
    return [nodes[first : first + LEAVES] for first in range(0, len(nodes), LEAVES)]


def best_first(session: SearchSession, guide: Guide | None = None) -> Steps[Outcome]:
    """Search for a goal of several facts: best-first by the relaxation's bound, which suits long sequences.

    What the bounds have refuted once on the way gets its second look at the end, when multi-bound search visits what
    is left, so this search is as complete as the others.

    Args:
        session: The search in progress.
        guide: Ranks the children of prefixes; None for none.
    """
    if not (yield from session.judge_scene()):
        return Outcome(PlanStatus.EXHAUSTED, seconds=session.seconds)

    front = PrefixFront(session, guide)
    session.progress(f"at least {session.tree.relaxation.lower_bound} actions are needed")
    while len(front):
        leaves = yield from front.advance(EXPANSIONS_AT_A_TIME)
        session.tree.counts.verdicts["leaf"] += len(leaves)
        outcome = yield from session.try_leaves(leaves)
        if outcome is not None:
            return outcome
        # Paths that failed may have raised the bound.
        if not (yield from session.judge_scene()):
            return Outcome(PlanStatus.EXHAUSTED, seconds=session.seconds)
    return (yield from multi_bound(session))


BLIND: dict[str, Callable[[SearchSession], Steps[Outcome]]] = {
    "mbts": multi_bound,
    "bfs": breadth_first,
}
"""Searches that need no network, by their names on the command line."""


class GuidedSearch(Protocol):
    """A search that a network guides."""

    def __call__(
        self, session: SearchSession, network: SequencePredictor[Images, Encoding]
    ) -> Steps[Outcome]:
        """Search with the network's predictions."""
        ...


GUIDED: dict[str, GuidedSearch] = {
    "dvr": visual_reasoning,
    "classifier": feasibility_classifier,
}
"""Searches that need a network, by name; the network's `kind` must be the same name."""

SEARCHES = (*GUIDED, *BLIND)
"""Names of all searches."""


def search(
    name: str,
    tree: SequenceTree,
    accept: Accept,
    progress: Progress,
    network: SequencePredictor[Images, Encoding] | None = None,
    termination: Termination = Termination.FEASIBLE,
    watch: Callable[[Steps[Outcome]], Steps[Outcome]] = lambda steps: steps,
    *,
    is_limit_open: bool = False,
    shortest: bool = False,
) -> Outcome:
    """Run a search until it finds a solution, has refuted all sequences, or the tree's deadline has passed.

    Args:
        name: Name of the search, one of `SEARCHES`.
        tree: Tree of the scene's sequences.
        accept: Function that returns whether the independent check accepts a feasible path.
        progress: Function that is called with lines of text about the progress.
        network: Network of the search's kind; None for a search that needs no network.
        termination: Whether paths are optimized further once they are feasible.
        watch: Function that passes the requests of the search on, and may look at them.
        is_limit_open: Whether the tree's `k_max` is raised if no sequence of so many actions solves the scene: to the
            lower bound on the number of actions plus `SPARE_ACTIONS`. The search of these longer sequences ends after
            `LONGER_WORK`.
        shortest: Whether the solution has the least number of actions.
    """
    session = SearchSession(tree, accept, progress, termination)
    found = Outcome(PlanStatus.TIME_LIMIT, seconds=session.seconds)
    try:
        if is_limit_open and has_several_facts(tree.scene):
            run_alone(_raise_limit(session))
        found = run_alone(watch(steps_of(name, session, network)))
        is_open = is_limit_open and found.status == PlanStatus.EXHAUSTED
        if is_open:
            found = _search_longer(session, found, lambda: watch(steps_of(name, session, network)))
        if shortest and found.node is not None:
            tree.k_max = found.node.depth - 1
            if run_alone(session.judge_scene()):
                shorter = run_alone(watch(multi_bound(session)))
                found = shorter if shorter.node is not None else found
    except OutOfTime:
        found.is_complete = False
    return found


def _search_longer(
    session: SearchSession, found: Outcome, begin_steps: Callable[[], Steps[Outcome]]
) -> Outcome:
    """Search sequences of more actions than `k_max`, if the relaxation allows any, with a limit of the work.

    Args:
        session: The search in progress.
        found: How the search of the shorter sequences ended.
        begin_steps: Function that returns a search up to the tree's `k_max`.

    Returns:
        How the search ends. If it does not come to a verdict on all longer sequences, `k_max` is what it was.
    """
    tree = session.tree
    k_max = tree.k_max
    begin = time.monotonic()
    try:
        if not run_alone(_raise_limit(session)):
            return found
        return run_alone(_limit_work(begin_steps(), LONGER_WORK))
    except OutOfTime:
        found.longer = LongerSearch(tree.k_max, time.monotonic() - begin)
        tree.k_max = k_max
        return found


def _limit_work(steps: Steps[Outcome], most: int) -> Steps[Outcome]:
    """Carry out a search, but give up when it has asked for too much work.

    The limit does not depend on the clock, so that a search ends in the same way on every machine.

    Args:
        steps: The search.
        most: Largest number of slices of all NLPs and beams.

    Raises:
        OutOfTime: The search has asked for more.
    """
    slices = 0
    reply: Reply | None = None
    while True:
        try:
            request = steps.send(reply)
        except StopIteration as stop:
            outcome: Outcome = stop.value
            return outcome
        slices += work_of(request)
        if slices > most:
            steps.close()
            raise OutOfTime
        reply = yield request


def _raise_limit(session: SearchSession) -> Steps[bool]:
    """Raise the largest number of actions by the lower bound of the relaxation.

    Returns:
        Whether it was raised. It is not if the bound shows that there is no solution of any length.
    """
    tree = session.tree
    if tree.relaxation.is_hopeless():
        return False
    with session.timed("relaxation"):
        least = yield from tree.relaxation.compute(tree.capacity)
    wanted = min(least + SPARE_ACTIONS, tree.capacity)
    if least > tree.capacity or wanted <= tree.k_max:
        return False
    tree.k_max = wanted
    session.progress(f"at least {least} actions are needed; sequences of up to {wanted} follow")
    return True


def steps_of(
    name: str, session: SearchSession, network: SequencePredictor[Images, Encoding] | None = None
) -> Steps[Outcome]:
    """Return the generator that carries out the search of this name.

    Args:
        name: Name of the search, one of `SEARCHES`.
        session: The search in progress.
        network: Network of the search's kind; None for a search that needs no network.

    Raises:
        DvrError: There is no search of this name, or it needs a network.
    """
    tree = session.tree
    several = has_several_facts(tree.scene)
    if name in BLIND:
        return best_first(session) if several and name != "bfs" else BLIND[name](session)
    if name not in GUIDED:
        raise DvrError(f"there is no search '{name}'; valid: {', '.join(SEARCHES)}.")
    if network is None:
        raise DvrError(
            f"the search '{name}' needs a network; valid without one: {', '.join(BLIND)}."
        )
    if several:
        return best_first(session, GoalGuide(tree, network))
    return GUIDED[name](session, network_for(tree.scene, network, tree.operators))


def has_several_facts(scene: Scene) -> bool:
    """Return whether the goal of a scene, or the way to it, is longer than those of the paper's scenes."""
    return not isinstance(scene.goal, OnRegion) and only_fact(scene) is None
