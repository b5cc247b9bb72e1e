"""Plan one scene: search for a sequence, optimise its path, and accept it only if the independent check does.

from dvr_jax.planning.planner import plan
from dvr_jax.scene.files import load_scene

result = plan(load_scene("data/scenes/figure1.json"), k_max=6)
print(result.status, *result.words, sep="\\n")
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import jax

from dvr_jax.checker import CheckReport
from dvr_jax.checker.replay import check_motion
from dvr_jax.errors import DvrError
from dvr_jax.logic import Action, describe
from dvr_jax.motion.motion import Motion
from dvr_jax.planning.feasibility import motion_of
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.reasoning import Network
from dvr_jax.search.searches import GUIDED, SEARCHES
from dvr_jax.search.searches import search as run_search
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.warm import warming_up
from dvr_jax.solver.engine import NlpSolution


@dataclass(frozen=True, slots=True)
class Plan:
    """Result of planning one scene."""

    scene: Scene
    status: PlanStatus
    """Whether a motion was found, and if not, why the search ended."""
    actions: tuple[Action, ...]
    """Empty unless solved."""
    motion: Motion | None
    report: CheckReport | None
    """The independent check of `motion`."""
    violations: dict[str, float]
    """Largest violation of each kind in the path NLP [m or rad]."""
    seconds: dict[str, float]
    """Time by stage, and "total" [s]."""
    nlps: dict[str, int]
    """NLPs solved by bound; every start counts."""
    verdicts: dict[str, int]
    """Prefixes judged by bound."""
    rejected: int
    """Feasible paths that the independent check refused."""
    options: dict[str, object] = field(default_factory=dict)
    """Search, k_max, seed, checksum of the network (None without) and time limit."""

    @property
    def solved(self) -> bool:
        """Whether there is a motion that passes the independent check."""
        return self.status == PlanStatus.SOLVED

    @property
    def words(self) -> tuple[str, ...]:
        """The actions in words."""
        return tuple(describe(action) for action in self.actions)


def plan(
    scene: Scene,
    search: str = "dvr",
    k_max: int = 6,
    seed: int = 0,
    time_limit: float = 300.0,
    progress: Callable[[str], None] = lambda line: None,
    network: Network | None = None,
) -> Plan:
    """Search, optimise and check.

    Args:
        scene: a valid scene.
        search: "dvr" (guided by a network as in the paper), "classifier" (by a feasibility classifier), "mbts"
        (multi-bound tree search) or "bfs" (breadth-first).
        k_max: largest number of actions, at least 1.
        seed: of all sampling; the same seed gives the same plan.
        time_limit: [s]; looked at between batches, so it is overrun by a few seconds at most once programs are
        compiled. Compilation, most of a minute on the first plan ever, counts.
        progress: takes a line about what is going on.
        network: of the search's kind (`dvr_jax.model.predictor.Predictor.load`), for "dvr" and "classifier"; by default
        the shipped one.
    """
    if k_max < 1:
        raise DvrError(f"k_max is {k_max}; valid is a whole number from 1.")
    if seed < 0:
        raise DvrError(f"the seed is {seed}; valid is a whole number from 0.")
    if not time_limit > 0:
        raise DvrError(f"the time limit is {time_limit} s; valid is a positive number.")
    if search not in SEARCHES:
        raise DvrError(f"there is no search '{search}'; valid: {', '.join(SEARCHES)}.")
    if network is not None and search not in GUIDED:
        raise DvrError(f"the search '{search}' takes no network; valid with one: {', '.join(GUIDED)}.")
    if network is None and search in GUIDED:
        # Here and not above: the other searches need not wait for the import of flax.
        from dvr_jax.model.predictor import load_network

        network = load_network(search)
    kind = getattr(network, "kind", search)
    if kind != search:
        raise DvrError(f"the network is of the kind '{kind}'; the search '{search}' needs one of its own kind.")
    begin = time.monotonic()
    # A scene that cannot be is refused here, before anything is compiled for it.
    tree = SequenceTree(scene, k_max, seed, deadline=begin + time_limit)
    # Tolerances of a micrometre need double precision. Set here and not on import, which must not change other users'
    # programs.
    with jax.enable_x64(True), warming_up(scene, k_max, network):
        accepted: list[tuple[Motion, CheckReport]] = []
        check_seconds, rejected = 0.0, 0

        def accept(node: Node, path: NlpSolution) -> bool:
            nonlocal check_seconds, rejected
            start = time.monotonic()
            motion = motion_of(scene, node, path)
            report = check_motion(scene, node.actions, motion)
            check_seconds += time.monotonic() - start
            if report.passed:
                accepted.append((motion, report))
            else:
                rejected += 1
                progress(f"refused by the check: {report.findings[0]}")
            return report.passed

        outcome = run_search(search, tree, accept, progress, network)
    motion, report = accepted[-1] if outcome.status == PlanStatus.SOLVED else (None, None)
    total = time.monotonic() - begin
    seconds = {**outcome.seconds, "check": check_seconds}
    return Plan(
        scene=scene,
        status=outcome.status,
        actions=outcome.node.actions if outcome.node is not None else (),
        motion=motion,
        report=report,
        violations=outcome.path.violations if outcome.path is not None else {},
        seconds={**seconds, "total": total},
        nlps=dict(tree.counts.nlps),
        verdicts=dict(tree.counts.verdicts),
        rejected=rejected,
        options={
            "search": search,
            "k_max": k_max,
            "seed": seed,
            "network": getattr(network, "checksum", None),
            "time_limit": time_limit if math.isfinite(time_limit) else None,
        },
    )
