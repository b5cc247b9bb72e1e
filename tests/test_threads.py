"""LAPACK keeps to one thread while the solver runs, and is as it was afterwards."""

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from dvr_jax.threads import linear_algebra_on_one_thread


@pytest.fixture(autouse=True)
def _needs_a_library_that_is_known() -> None:
    if not threads():
        pytest.skip("threadpoolctl knows no library here")


def threads() -> list[int]:
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]


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


def test_an_error_inside_restores_it_too() -> None:
    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        with pytest.raises(ZeroDivisionError), linear_algebra_on_one_thread():
            _ = 1 / 0
        assert threads() == before
