"""Work that searches ask for, and its execution: for one search alone, or for many at once in shared batches.

A search is a generator that yields requests and is sent their results. What it is sent does not depend on who else is
served with it: lanes of a batch do not know of each other."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeVar

from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.seeds.keyframe_beam import KeyframeBeam
from dvr_jax.solver.augmented_lagrangian import Settings
from dvr_jax.solver.engine import NlpSolution, beam_lanes, extend_beams, solve


@dataclass(frozen=True, slots=True)
class Extend:
    """KeyframeBeam of prefixes from those of their parents (`extend_beams`); the result is a list of `KeyframeBeam`."""

    parents: Sequence[KeyframeBeam]
    problems: Sequence[Problem]
    seed: int


@dataclass(frozen=True, slots=True)
class Solve:
    """NLPs of one shape from one start each (`solve`); the result is a list of `NlpSolution`."""

    problems: Sequence[Problem]
    starts: Sequence[Variables]
    settings: Settings


Request = Extend | Solve

T = TypeVar("T")
Steps = Generator[Request, Any, T]
"""A computation that asks for work on its way to a result of type T."""


def run_alone(steps: Steps[T]) -> T:
    """Run one computation to its end."""
    return next(run_together([steps]))[1]


def run_together(computations: Iterable[Steps[T]], width: int = 64) -> Iterator[tuple[int, T]]:
    """Run computations side by side, each request in a batch with the others'; yields (index, result) as they end.

    What one of them raises is raised here.

    Args:
        width: most computations under way at a time; the next one begins when one has ended.
    """
    waiting = enumerate(computations)
    running: dict[int, Steps[T]] = {}
    replies: dict[int, Any] = {}
    while True:
        pending: dict[int, Request] = {}
        ended: list[tuple[int, T]] = []
        while True:
            for index, reply in replies.items():
                try:
                    pending[index] = running[index].send(reply)
                except StopIteration as stop:
                    ended.append((index, stop.value))
                    del running[index]
            fresh = dict(islice(waiting, width - len(running)))
            running |= fresh
            replies = dict.fromkeys(fresh)
            if not fresh:
                break
        yield from ended
        if not running:
            return
        replies = _execute(pending)


def _execute(requests: dict[int, Request]) -> dict[int, list[Any]]:
    """Results of requests, in batches of what fits together."""
    batches: dict[tuple[Any, ...], list[int]] = {}
    for index, request in requests.items():
        batches.setdefault(_batch_key(request), []).append(index)
    replies: dict[int, list[Any]] = {}
    for members in batches.values():
        results = iter(_execute_batch([requests[index] for index in members]))
        for index in members:
            replies[index] = [next(results) for _ in requests[index].problems]
    return replies


def _batch_key(request: Request) -> tuple[Any, ...]:
    """Equal for requests that one call can serve."""
    if not request.problems:
        return (type(request),)
    objects = len(request.problems[0].half)
    if isinstance(request, Extend):
        return Extend, objects, request.parents[0].q.shape, request.seed
    return Solve, objects, request.starts[0].q.shape, request.starts[0].m.shape, request.settings


def _execute_batch(requests: list[Request]) -> list[KeyframeBeam] | list[NlpSolution]:
    problems = [problem for request in requests for problem in request.problems]
    first = requests[0]
    if isinstance(first, Extend):
        parents = [beam for request in requests if isinstance(request, Extend) for beam in request.parents]
        lanes = [count for request in requests for count in beam_lanes(request.problems)]
        return extend_beams(parents, problems, first.seed, lanes)
    starts = [start for request in requests if isinstance(request, Solve) for start in request.starts]
    return solve(problems, starts, first.settings)
