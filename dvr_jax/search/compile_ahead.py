"""Compile beside a search what it will soon need, on a machine that does not have its programs yet.

The programs of a plan depend on the number of its actions. The network's most promising sequence is usually right, so
its number of actions is assumed, and the programs of the path of this length are compiled first: they take longest, and
the search needs them last. Nothing is done before the search meets a program that the disk does not have.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from threading import Event, Lock, Thread, get_ident

import jax

from dvr_jax.operators import Operator
from dvr_jax.runtime.compilation import awaited_program, when_compiling
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.predictor import Encoding, Images, SequencePredictor
from dvr_jax.search.searches import steps_of
from dvr_jax.search.session import SearchSession
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.warm import Job, Programs, all_jobs
from dvr_jax.search.work import Steps, run_alone
from dvr_jax.solver.state import Termination

HELPERS = 2
"""Number of threads that compile beside the search. While the search waits for a program, both cores of a small
machine have work."""

IDLE_WAIT = 0.1
"""Time between two looks at whether the search waits for a program [s]."""

_is_allowed = True
"""Whether this process has cores to spare."""


def compile_nothing_ahead() -> None:
    """Let this process compile a program only when it is called, because the process has a single core."""
    global _is_allowed
    _is_allowed = False


@contextmanager
def compiling_ahead(
    scene: Scene,
    k_max: int,
    network: SequencePredictor[Images, Encoding] | None,
    operators: Sequence[Operator],
    termination: Termination,
) -> Iterator[None]:
    """Compile on other cores what the work inside will soon need, from the first program on that it has to compile.

    Args:
        scene: The scene of the work inside.
        k_max: Largest number of actions.
        network: The network that guides the search, if any.
        operators: The operators that are known.
        termination: Whether paths will be optimized.
    """
    if not _is_allowed or (os.cpu_count() or 1) == 1:
        yield
        return

    def list_jobs() -> tuple[list[Job], list[Job]]:
        """Return what is needed soon, and what may be needed later."""
        programs = Programs(scene, k_max, operators)
        everything = all_jobs(programs, scene, network, termination)
        if network is None:
            return everything, []
        length = likely_length(scene, k_max, network, operators)
        return _jobs_of_length(programs, length, termination), everything

    helpers = _Helpers(list_jobs)
    try:
        with when_compiling(helpers.start):
            yield
    finally:
        # Each thread ends with the program that it is at.
        helpers.stop()


def likely_length(
    scene: Scene,
    k_max: int,
    network: SequencePredictor[Images, Encoding],
    operators: Sequence[Operator],
) -> int:
    """Return the number of actions of the sequence whose path a guided search will try first if no bound refutes it.

    Args:
        scene: The scene.
        k_max: Largest number of actions.
        network: The network that guides the search.
        operators: The operators that are known.
    """
    tree = SequenceTree(scene, k_max, operators=operators)
    session = _FirstLeaves(tree, accept=lambda *_: False, progress=lambda _: None)
    try:
        run_alone(steps_of(network.kind, session, network))
    except _Found as found:
        return found.length
    return k_max


class _Found(Exception):
    """The first sequences that a search judges are known."""

    def __init__(self, length: int) -> None:
        """Keep the number of actions of the first of them."""
        super().__init__()
        self.length = length


class _FirstLeaves(SearchSession):
    """A search that ends where the first bound of a complete sequence would be computed."""

    def judge_prefix_chains(self, leaves: list[Node]) -> Steps[list[Node]]:
        """Raise `_Found`."""
        raise _Found(leaves[0].depth)

    def judge_leaves(self, leaves: list[Node]) -> Steps[list[Node]]:
        """Raise `_Found`."""
        raise _Found(leaves[0].depth)


def _jobs_of_length(programs: Programs, length: int, termination: Termination) -> list[Job]:
    """Return what a search needs whose first sequence of this length is right."""
    jobs: list[Job] = []
    if termination == Termination.OPTIMAL:
        jobs.append(partial(programs.optimize_path, length))
    keyframes = [partial(programs.solve_keyframes, number) for number in range(2, length + 1)]
    jobs += keyframes[:1]
    jobs.append(partial(programs.solve_path, length))
    return [*jobs, *keyframes[1:]]


class _Helpers:
    """Threads that compile, one job each at a time."""

    def __init__(self, list_jobs: Callable[[], tuple[list[Job], list[Job]]]) -> None:
        """Keep in mind what is to be done; no thread is started yet."""
        self._list_jobs = list_jobs
        self._lock = Lock()
        self._has_started = False
        self._ended = Event()
        self._soon: list[Job] = []
        self._later: list[Job] = []
        self._caller = get_ident()

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

    def _begin(self) -> None:
        """List the jobs, start the other threads, and work."""
        with jax.enable_x64(True):
            self._soon, self._later = self._list_jobs()

        for _ in range(HELPERS - 1):
            Thread(target=self._work).start()
        self._work()

    def _work(self) -> None:
        """Do one job after the other."""
        with jax.enable_x64(True):
            while (job := self._next_job()) is not None:
                job()

    def _next_job(self) -> Job | None:
        """Return the next job; None if there is none left or the search has ended."""
        while not self._ended.is_set():
            with self._lock:
                if self._soon:
                    return self._soon.pop(0)
                if not self._later:
                    return None
                # What may be needed later must not take time from what the search waits for now.
                if awaited_program(self._caller) is None:
                    return self._later.pop(0)
            self._ended.wait(IDLE_WAIT)
        return None
