"""Requests for numerical work and their execution, for one search alone or for many searches in shared batches.

A search is a Python generator that yields requests and is sent their results. The results for one search do not depend
on the other searches that share a batch with it, because the lanes of a batch are independent.
"""

from __future__ import annotations

from collections.abc import Generator, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeVar

from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.seeds.beam_batches import BeamTask, extend_beams
from dvr_jax.seeds.keyframe_beam import KeyframeBeam
from dvr_jax.solver.lane_pool import AnySettings, NlpSolution, solve
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
    """The NLPs."""

    starts: Sequence[Variables]
    """A starting point for each NLP."""

    settings: AnySettings
    """Settings of the solver; their type decides which method is used."""


Request = ExtendBeams | SolveNlps
"""A request for work."""

Reply = list[KeyframeBeam] | list[NlpSolution]
"""The results of a request."""

T = TypeVar("T")
"""Type of a computation's result."""

Steps = Generator[Request, Any, T]
"""A computation that yields requests for work, is sent the replies, and returns a result of type T."""


def work_of(request: Request) -> int:
    """Return the number of slices that a request is about: those of its NLPs, or one for each beam."""
    if isinstance(request, ExtendBeams):
        return len(request.tasks)
    return sum(len(start.q) for start in request.starts)


def run_alone(steps: Steps[T]) -> T:
    """Run one computation to its end and return its result."""
    return next(run_together([steps]))[1]


def run_together(computations: Iterable[Steps[T]], width: int = 64) -> Iterator[tuple[int, T]]:
    """Run computations concurrently, and execute their requests in shared batches.

    Args:
        computations: The computations. An exception of one of them is raised here.
        width: Largest number of computations that run at a time; the next one begins when one has ended.

    Yields:
        Number and result of each computation as it ends.
    """
    waiting = enumerate(computations)
    running: dict[int, Steps[T]] = {}
    replies: dict[int, Reply | None] = {}
    while True:
        pending: dict[int, Request] = {}
        ended: list[tuple[int, T]] = []

        # A computation that ends is replaced by a new one, until all running computations wait for a reply.
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
    """Send computations their replies, store their next requests in `pending`, and return the results of ended ones."""
    ended = []
    for index, reply in replies.items():
        try:
            pending[index] = running[index].send(reply)
        except StopIteration as stop:
            ended.append((index, stop.value))
            del running[index]
    return ended


def _execute(requests: dict[int, Request]) -> dict[int, Reply]:
    """Execute requests, those that fit together in one batch, and return their results."""
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
    """Return the number of results that a request asks for."""
    return len(request.tasks) if isinstance(request, ExtendBeams) else len(request.problems)


def _batch_key(request: Request) -> Hashable:
    """Return a key that is equal for requests that one batch can serve."""
    if not _size(request):
        return (type(request),)
    # Robots of the same structure may have other dimensions, so the identity of the link offsets is part of the key.
    model = request.model.structure, id(request.model.link_offsets)
    if isinstance(request, ExtendBeams):
        first = request.tasks[0]
        sizes = _sizes(first.problem)
        return ExtendBeams, model, sizes, first.parent.q.shape, request.seed
    problem = request.problems[0]
    sizes = _sizes(problem)
    start = request.starts[0]
    return SolveNlps, model, sizes, start.q.shape, start.m.shape, request.settings


def _sizes(problem: Problem) -> tuple[int, ...]:
    """Return the numbers of objects, of fixed bodies, of regions that stay clear, and of tops of an action."""
    return (
        len(problem.prism),
        len(problem.fixed_prism),
        problem.kept_clear.shape[-2],
        problem.top_object.shape[-1],
    )


def _execute_batch(requests: list[Request]) -> Reply:
    """Execute requests that fit together, and return their results one after the other."""
    first = requests[0]
    if isinstance(first, ExtendBeams):
        beams = [request for request in requests if isinstance(request, ExtendBeams)]
        tasks = [task for request in beams for task in request.tasks]
        return extend_beams(first.model, tasks, first.seed)

    solves = [request for request in requests if isinstance(request, SolveNlps)]
    problems = [problem for request in solves for problem in request.problems]
    starts = [start for request in solves for start in request.starts]
    return solve(first.model, problems, starts, first.settings)
