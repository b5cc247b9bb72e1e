"""LAPACK keeps to one thread while the solver runs, and is as it was afterwards."""

from contextlib import ExitStack
from threading import Event, Thread

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from dvr_jax.runtime.threads import linear_algebra_on_one_thread


@pytest.fixture(autouse=True)
def _needs_a_library_that_is_known() -> None:
    if not threads():
        pytest.skip("threadpoolctl knows no library here")


def threads() -> list[int]:
    return [
        library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"
    ]


def test_overlapping_blocks_end_with_the_last() -> None:
    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        assert max(before) == 2
        first, second = linear_algebra_on_one_thread(), linear_algebra_on_one_thread()
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert set(threads()) == {1}
        second.__exit__(None, None, None)
        assert threads() == before


@pytest.mark.parametrize("ends_first", ["this thread", "the other one"])
@pytest.mark.parametrize("begins_first", ["this thread", "the other one"])
def test_blocks_of_two_threads_overlap(begins_first: str, ends_first: str) -> None:
    """This thread sets a limit first of all, which makes it the only one that threadpoolctl listens to."""
    other = OtherThread()
    with threadpool_limits(limits=2, user_api="blas"), ExitStack() as here:
        before = threads()
        entries = [lambda: here.enter_context(linear_algebra_on_one_thread()), other.enter]
        for enter in entries if begins_first == "this thread" else entries[::-1]:
            enter()
            assert set(threads()) == {1}
        first, last = (
            (here.close, other.leave) if ends_first == "this thread" else (other.leave, here.close)
        )
        first()
        assert set(threads()) == {1}
        last()
        assert threads() == before


class OtherThread:
    """A thread that is inside the block between `enter` and `leave`."""

    def __init__(self) -> None:
        self.entered, self.to_leave, self.left = Event(), Event(), Event()

    def enter(self) -> None:
        Thread(target=self._run, daemon=True).start()
        assert self.entered.wait(10)

    def leave(self) -> None:
        self.to_leave.set()
        assert self.left.wait(10)

    def _run(self) -> None:
        with linear_algebra_on_one_thread():
            self.entered.set()
            self.to_leave.wait(10)
        self.left.set()


def test_an_error_inside_restores_it_too() -> None:
    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        with pytest.raises(ZeroDivisionError), linear_algebra_on_one_thread():
            _ = 1 / 0
        assert threads() == before
