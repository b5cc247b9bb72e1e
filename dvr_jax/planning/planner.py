"""Plan one scene: search for a sequence, optimize its path, and accept the path only if the independent check passes.

from dvr_jax import load_scene, plan

result = plan(load_scene("data/scenes/figure1.json"), k_max=6)
print(result.status, *result.action_descriptions, sep="\\n")
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import jax

from dvr_jax.checker import CHECKS, CheckReport, OperatorCheck, check_motion
from dvr_jax.errors import OptionError
from dvr_jax.motion.motion import Motion
from dvr_jax.operators import OPERATORS, Operator
from dvr_jax.planning.arguments import (
    LARGEST_K_MAX,
    describe_value,
    require_integer,
    require_number,
    require_positive,
    require_scene,
)
from dvr_jax.planning.feasibility import motion_of
from dvr_jax.planning.goal_met import resting_plan
from dvr_jax.planning.networks import choose_search
from dvr_jax.planning.path_quality import TERMINATIONS, PathQuality, quality_of
from dvr_jax.planning.result import Plan
from dvr_jax.scene.types import Scene
from dvr_jax.search.compile_ahead import compiling_ahead
from dvr_jax.search.explanation import explain_scene, promising_refutations
from dvr_jax.search.node import Node
from dvr_jax.search.predictor import Encoding, Images, SequencePredictor
from dvr_jax.search.searches import has_several_facts
from dvr_jax.search.searches import search as run_search
from dvr_jax.search.session import Outcome
from dvr_jax.search.tree import SequenceTree
from dvr_jax.solver.lane_pool import NlpSolution
from dvr_jax.solver.state import Termination

__all__ = ["Plan", "plan"]

USUAL_K_MAX = 6
"""Largest number of actions of the sequences that are searched first if the caller states none."""


def plan(
    scene: Scene,
    search: str = "dvr",
    k_max: int | None = None,
    seed: int = 0,
    time_limit: float = 300.0,
    progress: Callable[[str], None] | None = None,
    network: SequencePredictor[Images, Encoding] | None = None,
    operators: Sequence[Operator] = OPERATORS,
    checks: Sequence[OperatorCheck] = CHECKS,
    clearance: float = 1.0,
    termination: str = "optimal",
    shortest: bool = False,
) -> Plan:
    """Find a sequence of actions that solves a scene, and a motion that carries it out and passes the check.

    Args:
        scene: Valid scene.
        search: "dvr" (guided by a network as in the paper), "classifier" (guided by a feasibility classifier), "mbts"
            (multi-bound tree search) or "bfs" (breadth-first search).
        k_max: Largest number of actions, 1 to 50. None allows 6 actions, and if no sequence of so many solves the
            scene, up to the lower bound on the number of actions plus 4. These longer sequences are searched with a
            limited effort; if it does not suffice, the answer is about 6 actions, and `Plan.options` has the entry
            "longer_k_max" and `Plan.seconds` the entry "longer".
        seed: Seed of all sampling, from 0. The same seed gives the same plan.
        time_limit: Time after which the search gives up [s]. The clock is read between batches, so the search can
            exceed the limit by a few seconds. The time includes compilation, which takes most of a minute for the
            first plan on a machine.
        progress: Function that is called with one line of text about each step; None reports nothing.
        network: Network of the search's kind, for "dvr" and "classifier"; None for the shipped one. If the shipped
            network was trained in another workcell or for other operators, the search "mbts" is used instead.
        operators: Operators that the plan may consist of.
        checks: The operators' counterparts in the independent check, one for each operator.
        clearance: Factor of the workcell's clearances, from 0 to 3.
        termination: "optimal" if the path is optimized until it satisfies the KKT conditions, or "feasible" if the
            first feasible path will do, whose motion takes longer.
        shortest: Whether the plan has the least number of actions. After a plan was found, all shorter sequences are
            judged, unless the lower bound on the number of actions shows that there is none.

    Returns:
        The plan. Its status says whether a motion was found, and if not, why the search ended.

    Raises:
        OptionError: An argument has a wrong type or value.
        DvrError: The arms are in collision in the scene's initial state, or the scene is too large for the network.
    """
    scene = require_scene(scene)
    is_limit_open = k_max is None
    if k_max is None:
        k_max = USUAL_K_MAX
    k_max = require_integer("k_max", k_max, least=1, most=LARGEST_K_MAX)
    seed = require_integer("the seed", seed, least=0)
    time_limit = require_positive("the time limit", time_limit, "s")
    mode = _require_termination(termination)
    clearance = require_number("the clearance", clearance)
    planned = scene.with_clearance(clearance)
    say = progress or _say_nothing
    search, chosen_network = choose_search(search, network, scene, operators, say)
    begin = time.monotonic()

    # The tree refuses a scene whose arms collide at home, before anything is compiled for it.
    tree = SequenceTree(planned, k_max, seed, deadline=begin + time_limit, operators=operators)
    acceptance = _Acceptance(planned, say, checks)
    options: dict[str, object] = {
        "search": search,
        "k_max": k_max,
        "seed": seed,
        "network": None if chosen_network is None else chosen_network.checksum,
        "time_limit": time_limit if math.isfinite(time_limit) else None,
        "clearance": clearance,
        "termination": termination,
        "shortest": shortest,
    }
    rest = resting_plan(scene, operators, checks, options)
    if rest is not None:
        say("the goal holds already: no action is needed")
        return rest

    # Tolerances of a micrometer need double precision. It is switched on here and not on import, because the import of
    # a package must not change the programs of others.
    ahead = compiling_ahead(planned, k_max, chosen_network, operators, mode, tree.relaxation)
    with jax.enable_x64(True), ahead as watch:
        outcome = run_search(
            search,
            tree,
            acceptance.accept,
            acceptance.progress,
            chosen_network,
            mode,
            watch,
            is_limit_open=is_limit_open,
            shortest=shortest,
        )
    if is_limit_open and (outcome.node is None or has_several_facts(planned)):
        # If all longer sequences are refuted too, the search has raised the limit to this number.
        options["k_max"] = tree.k_max
    if outcome.longer is not None:
        options["longer_k_max"] = outcome.longer.k_max
        outcome.seconds["longer"] = outcome.longer.seconds

    found = _make_plan(tree, outcome, acceptance, options, total_seconds=time.monotonic() - begin)
    return replace(found, scene=scene)


def _require_termination(termination: str) -> Termination:
    """Return the termination mode of a name, or refuse the name."""
    if termination not in TERMINATIONS:
        raise OptionError(
            f"the termination is {describe_value(termination)}; valid: {', '.join(TERMINATIONS)}."
        )
    return Termination[termination.upper()]


class _Acceptance:
    """Turns feasible paths into motions, runs the independent check on them, and keeps the motion that passes."""

    def __init__(
        self, scene: Scene, progress: Callable[[str], None], checks: Sequence[OperatorCheck]
    ) -> None:
        self.scene = scene
        self.checks = checks
        self.progress = progress
        self.motion: Motion | None = None
        """Motion that the check accepted."""
        self.report: CheckReport | None = None
        """Report of the check on `motion`."""
        self.rejected = 0
        """Number of paths that the check refused."""
        self.seconds = 0.0
        """Time spent on motions and their checks [s]."""

    def accept(self, node: Node, path: NlpSolution) -> bool:
        """Check the motion of a path and keep it if it passes.

        Args:
            node: Sequence of the path.
            path: Feasible solution of its path NLP.

        Returns:
            Whether the check accepts the motion.
        """
        start = time.monotonic()
        motion = motion_of(self.scene, node, path)
        report = check_motion(self.scene, node.actions, motion, self.checks)
        self.seconds += time.monotonic() - start

        if report.passed:
            self.motion = motion
            self.report = report
        else:
            self.rejected += 1
            self.progress(f"refused by the check: {report.findings[0]}")

        return report.passed


def _make_plan(
    tree: SequenceTree,
    outcome: Outcome,
    acceptance: _Acceptance,
    options: dict[str, object],
    total_seconds: float,
) -> Plan:
    """Assemble the plan from the outcome of the search, the result of the check and the measured times."""
    seconds = {
        **outcome.seconds,
        "check": acceptance.seconds,
        "total": total_seconds,
    }
    return Plan(
        scene=tree.scene,
        status=outcome.status,
        actions=outcome.node.actions if outcome.node is not None else (),
        motion=acceptance.motion,
        report=acceptance.report,
        path=_quality(outcome),
        violations=outcome.path.violations if outcome.path is not None else {},
        seconds=seconds,
        nlps=dict(tree.counts.nlps),
        verdicts=dict(tree.counts.verdicts),
        rejected=acceptance.rejected,
        reason=explain_scene(tree) if outcome.node is None else None,
        refuted=tuple(promising_refutations(tree)) if outcome.node is None else (),
        options=options,
        operators=tuple(tree.operators),
    )


def _quality(outcome: Outcome) -> PathQuality | None:
    """Return the quality of the path that a search ended with, or None without one."""
    if outcome.path is None or outcome.node is None or outcome.node.problem is None:
        return None
    return quality_of(outcome.node.problem, outcome.path)


def _say_nothing(line: str) -> None:
    """Ignore a line of progress."""
