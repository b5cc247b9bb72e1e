"""Work that searches ask for, and its execution: for one search alone, or for many at once in shared batches.

A search is a generator that yields requests and is sent their results. What it is sent does not depend on who else is
served with it: lanes of a batch do not know of each other.
"""

from __future__ import annotations

from collections.abc import Generator, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeVar

from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.seeds.beam_batches import BeamTask, extend_beams, lane_counts
from dvr_jax.seeds.keyframe_beam import KeyframeBeam
from dvr_jax.solver.augmented_lagrangian import Settings
from dvr_jax.solver.lane_pool import NlpSolution, solve
from dvr_jax.workcell.model import WorkcellModel


@dataclass(frozen=True, slots=True)
class ExtendBeams:
    """A request for the beams of prefixes; the result is a list of `KeyframeBeam`."""

    model: WorkcellModel
    """Arms of the workcell."""

    tasks: Sequence[BeamTask]
    """The prefixes."""

    seed: int
    """Seed of the sample."""


@dataclass(frozen=True, slots=True)
class SolveNlps:
    """A request to solve NLPs of one shape from one start each; the result is a list of `NlpSolution`."""

    model: WorkcellModel
    """Arms of the workcell."""

    problems: Sequence[Problem]
    starts: Sequence[Variables]
    settings: Settings


Request = ExtendBeams | SolveNlps
Reply = list[KeyframeBeam] | list[NlpSolution]

T = TypeVar("T")
Steps = Generator[Request, Any, T]
"""A computation that asks for work on its way to a result of type T."""


def run_alone(steps: Steps[T]) -> T:
    """Run one computation to its end and return its result."""
    return next(run_together([steps]))[1]


def run_together(computations: Iterable[Steps[T]], width: int = 64) -> Iterator[tuple[int, T]]:
    """Run computations side by side, each request in a batch with the others'.

    Args:
        computations: The computations. What one of them raises is raised here.
        width: Most computations under way at a time; the next one begins when one has ended.

    Yields:
        Number and result of each computation as it ends.
    """
    waiting = enumerate(computations)
    running: dict[int, Steps[T]] = {}
    replies: dict[int, Reply | None] = {}
    while True:
        pending: dict[int, Request] = {}
        ended: list[tuple[int, T]] = []

        # Computations that end at once make room for others, until all that are under way wait for a reply.
        while True:
            ended += _send(running, replies, pending)
            fresh = dict(islice(waiting, width - len(running)))
            running |= fresh
            replies = dict.fromkeys(fresh)
            if not fresh:
                break

        yield from ended
        if not running:
            return
        replies = dict(_execute(pending))


def _send(
    running: dict[int, Steps[T]], replies: dict[int, Reply | None], pending: dict[int, Request]
) -> list[tuple[int, T]]:
    """Send computations their replies; note what they ask for next, and return those that have ended."""
    ended = []
    for index, reply in replies.items():
        try:
            pending[index] = running[index].send(reply)
        except StopIteration as stop:
            ended.append((index, stop.value))
            del running[index]
    return ended


def _execute(requests: dict[int, Request]) -> dict[int, Reply]:
    """Results of requests, in batches of what fits together."""
    batches: dict[Hashable, list[int]] = {}
    for index, request in requests.items():
        batches.setdefault(_batch_key(request), []).append(index)

    replies: dict[int, Reply] = {}
    for members in batches.values():
        results: Iterator[Any] = iter(_execute_batch([requests[index] for index in members]))
        for index in members:
            replies[index] = list(islice(results, _size(requests[index])))
    return replies


def _size(request: Request) -> int:
    """Number of results that a request asks for."""
    return len(request.tasks) if isinstance(request, ExtendBeams) else len(request.problems)


def _batch_key(request: Request) -> Hashable:
    """Equal for requests that one call can serve."""
    if not _size(request):
        return (type(request),)
    # Arms of equal structure have equal models, but for robots of the same make-up and other dimensions.
    model = request.model.structure, id(request.model.link_offsets)
    if isinstance(request, ExtendBeams):
        first = request.tasks[0]
        sizes = len(first.problem.prism), len(first.problem.fixed_prism)
        return ExtendBeams, model, sizes, first.parent.q.shape, request.seed
    problem = request.problems[0]
    sizes = len(problem.prism), len(problem.fixed_prism)
    start = request.starts[0]
    return SolveNlps, model, sizes, start.q.shape, start.m.shape, request.settings


def _execute_batch(requests: list[Request]) -> Reply:
    """Results of requests that fit together, one after the other."""
    first = requests[0]
    if isinstance(first, ExtendBeams):
        # How many lanes share a call depends on each request alone, not on its company.
        beams = [request for request in requests if isinstance(request, ExtendBeams)]
        tasks = [task for request in beams for task in request.tasks]
        lanes = [count for request in beams for count in lane_counts(request.tasks)]
        return extend_beams(first.model, tasks, lanes, first.seed)

    solves = [request for request in requests if isinstance(request, SolveNlps)]
    problems = [problem for request in solves for problem in request.problems]
    starts = [start for request in solves for start in request.starts]
    return solve(first.model, problems, starts, first.settings)
