"""Compile beside a search what it will soon need, on a machine that does not have its programs yet.

The programs of a plan depend on the number of its actions. The network's most promising sequence is usually right, so
its number of actions is assumed at first. If that sequence fails, the lower bound of the relaxation is the next guess:
most plans have as many actions. The requests of the search tell which path it solves in the end. What every search
needs comes first, and a guess that is often wrong gets only the time that the search leaves. Nothing is done before the
search meets a program that the disk does not have.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from functools import partial
from threading import Event, Lock, Thread, get_ident
from typing import Any, TypeVar

import jax

from dvr_jax.operators import Operator
from dvr_jax.runtime.compilation import awaited_program, when_compiling
from dvr_jax.scene.types import Scene
from dvr_jax.search.first_guess import likely_length
from dvr_jax.search.predictor import Encoding, Images, SequencePredictor
from dvr_jax.search.relaxation import Relaxation
from dvr_jax.search.searches import has_several_facts
from dvr_jax.search.warm import Job, Programs, all_jobs
from dvr_jax.search.work import ExtendBeams, Request, Steps
from dvr_jax.solver.state import Settings, Termination

T = TypeVar("T")
"""Type of a search's result."""

HELPERS = 2
"""Number of threads that compile beside the search. While the search waits for a program, both cores of a small
machine have work."""

SURE_LENGTH = 2
"""Largest number of actions of sequences that the network seldom gets wrong."""

IDLE_WAIT = 0.1
"""Time between two looks at whether the search waits for a program [s]."""

FREE_LOOKS = 4
"""Number of such looks in succession after which the search is known to compute. A single look may fall between two
programs that it waits for."""

_is_allowed = True
"""Whether this process has cores to spare."""


def compile_nothing_ahead() -> None:
    """Let this process compile a program only when it is called, because the process has a single core."""
    global _is_allowed
    _is_allowed = False


Watch = Callable[[Steps[T]], Steps[T]]
"""Function that passes the requests of a search on, and looks at them."""


@contextmanager
def compiling_ahead(
    scene: Scene,
    k_max: int,
    network: SequencePredictor[Images, Encoding] | None,
    operators: Sequence[Operator],
    termination: Termination,
    relaxation: Relaxation | None = None,
) -> Iterator[Watch[Any]]:
    """Compile on other cores what the work inside will soon need, from the first program on that it has to compile.

    Args:
        scene: The scene of the work inside.
        k_max: Largest number of actions.
        network: The network that guides the search, if any.
        operators: The operators that are known.
        termination: Whether paths will be optimized.
        relaxation: The scene's lower bounds, which the work inside computes; None if it does without.

    Yields:
        A function through which the requests of the search are to pass.
    """
    # The length of a sequence for several facts is not guessed.
    is_guessed = not has_several_facts(scene)
    if not is_guessed or not _is_allowed or (os.cpu_count() or 1) == 1:
        yield lambda steps: steps
        return

    helpers = _Helpers(scene, k_max, network, operators, termination, relaxation)
    try:
        with when_compiling(helpers.start):
            yield helpers.watch
    finally:
        # Each thread ends with the program that it is at.
        helpers.stop()


class _JobKind(Enum):
    """What a job compiles; the values are methods of `Programs`."""

    BEAM = "beam"
    KEYFRAMES = "keyframes"
    PATH = "path"
    OPTIMUM = "optimum"


@dataclass(frozen=True, slots=True)
class _Job:
    """The programs of one kind of NLP with one number of actions."""

    kind: _JobKind
    length: int

    def bound_to(self, programs: Programs) -> Job:
        """Return the call that compiles the programs."""
        return partial(getattr(programs, self.kind.value), self.length)

    @property
    def is_of_path(self) -> bool:
        """Whether the programs serve paths."""
        return self.kind in (_JobKind.PATH, _JobKind.OPTIMUM)


def _jobs_of_length(length: int, is_optimal: bool) -> list[_Job]:
    """Return what a search needs if its first sequence has this length and is right, in the order of compilation.

    Of 40 scenes with three boxes, 23 of the 28 plans with more than two actions needed keyframe NLPs, and in 9 of them
    the first sequence was wrong. Plans with two actions seldom need keyframe NLPs, because a sample proves that the
    prefix is feasible, and their first sequence was always right.
    """
    keyframes = [_Job(_JobKind.KEYFRAMES, number) for number in range(2, length + 1)]
    path = [_Job(_JobKind.PATH, length)]
    if is_optimal:
        path.append(_Job(_JobKind.OPTIMUM, length))
    early = keyframes[:2] if length > SURE_LENGTH else []
    return [_Job(_JobKind.BEAM, 1), *early, *path, *keyframes[len(early) :]]


class _Helpers:
    """Threads that compile, one job each at a time."""

    def __init__(
        self,
        scene: Scene,
        k_max: int,
        network: SequencePredictor[Images, Encoding] | None,
        operators: Sequence[Operator],
        termination: Termination,
        relaxation: Relaxation | None = None,
    ) -> None:
        """Keep in mind what the search is; no thread is started yet."""
        self.relaxation = relaxation
        self.scene = scene
        self.k_max = k_max
        self.network = network
        self.operators = operators
        self.is_optimal = termination == Termination.OPTIMAL
        self.termination = termination
        self._lock = Lock()
        self._has_started = False
        self._ended = Event()
        self._searcher = get_ident()
        self._programs: Programs | None = None
        self._length: int | None = None
        """Number of actions of the path that the search is going to solve, or solves."""
        self._is_guess = True
        """Whether this number is not known from a request of the search."""
        self._is_bound = False
        """Whether this number is the lower bound of the relaxation."""
        self._judged = 0
        """Largest number of actions whose keyframes the search has asked for."""
        self._soon: list[_Job] = []
        """Programs that the search is likely to need."""
        self._later: list[Job] = []
        """Programs that other sequences and other scenes need."""

    def start(self) -> None:
        """Start the threads unless they run already."""
        with self._lock:
            if self._has_started:
                return
            self._has_started = True
        Thread(target=self._begin).start()

    def stop(self) -> None:
        """Let the threads end with the programs that they are at."""
        self._ended.set()

    def watch(self, steps: Steps[T]) -> Steps[T]:
        """Pass the requests of a search on, and learn from them what it will need."""
        reply: Any = None
        while True:
            try:
                request = steps.send(reply)
            except StopIteration as stop:
                result: T = stop.value
                return result
            self._learn(request)
            reply = yield request

    def _learn(self, request: Request) -> None:
        """Correct the number of actions of the path."""
        if isinstance(request, ExtendBeams):
            # Several sequences are judged at a time only after the most promising one has failed.
            if self._is_guess and len(request.tasks) > 1 and not self._is_bound:
                needed = self._needed_actions()
                self._is_bound = needed is not None
                self._expect_path(needed)
            return

        if not request.starts:
            return
        slices, phases = (len(part) for part in request.starts[0])
        if slices == phases:
            self._judged = max(self._judged, phases)
            return
        if isinstance(request.settings, Settings):
            is_new = self._is_guess or phases != self._length
            self._is_guess = False
            if is_new:
                self._expect_path(phases)

    def _needed_actions(self) -> int | None:
        """Return the lower bound on the number of actions, or None if it is not known or too large."""
        if self.relaxation is None or not self.relaxation.is_computed:
            return None
        needed = self.relaxation.lower_bound
        return needed if 2 <= needed <= self.k_max else None

    def _expect_path(self, length: int | None) -> None:
        """Replace the programs of the path by those of another length, or by none."""
        with self._lock:
            self._length = length
            self._soon = [job for job in self._soon if not job.is_of_path]
            if length is None:
                return
            if self._is_guess:
                # The search judges the keyframes of all shorter prefixes before it tries a path.
                listed = {job.length for job in self._soon if job.kind is _JobKind.KEYFRAMES}
                self._soon += [
                    _Job(_JobKind.KEYFRAMES, number)
                    for number in range(self._judged + 1, length + 1)
                    if number not in listed
                ]
                self._soon.append(_Job(_JobKind.PATH, length))
            if self.is_optimal:
                # The search itself is about to compile the program of a feasible path that it asks for.
                place = len(self._soon) if self._is_guess else 0
                self._soon.insert(place, _Job(_JobKind.OPTIMUM, length))

    def _begin(self) -> None:
        """List the jobs, start the other threads, and work."""
        with jax.enable_x64(True):
            programs = Programs(self.scene, self.k_max, self.operators)
            later = all_jobs(programs, self.scene, self.network, self.termination)
            length = None
            if self.network is not None:
                length = likely_length(self.scene, self.k_max, self.network, self.operators)

        with self._lock:
            self._programs = programs
            self._later = later
            if length is not None and self._is_guess:
                self._length = length
                self._soon = _jobs_of_length(length, self.is_optimal)

        for _ in range(HELPERS - 1):
            Thread(target=self._work).start()
        self._work()

    def _work(self) -> None:
        """Do one job after the other."""
        with jax.enable_x64(True):
            while (job := self._next_job()) is not None:
                job()

    def _is_sure(self, job: _Job) -> bool:
        """Return whether the search will need a job, as far as anybody knows: a longer sequence is often wrong."""
        if not job.is_of_path:
            return True
        return not self._is_guess or self._is_bound or job.length <= SURE_LENGTH

    def _next_job(self) -> Job | None:
        """Return the next job; None if there is none left or the search has ended."""
        looks = 0
        while not self._ended.is_set():
            # What a guided search may need later must not take time from what it waits for now.
            looks = looks + 1 if awaited_program(self._searcher) is None else 0
            is_free = self.network is None or looks >= FREE_LOOKS
            with self._lock:
                if self._soon and (is_free or self._is_sure(self._soon[0])):
                    assert self._programs is not None
                    return self._soon.pop(0).bound_to(self._programs)
                if self._later and not self._soon and is_free:
                    return self._later.pop(0)
                if not self._later:
                    return None
            self._ended.wait(IDLE_WAIT)
        return None
