"""Times of two checkouts: read from what 0.8.1 printed and from what is printed now, and compared by the least ones."""

from pathlib import Path

import pytest

from dvr_jax.bench.compare import compare_least, find_checkout, parse_times
from dvr_jax.bench.speed_metrics import KeyframeTimes, PathTimes, SliceTimes
from dvr_jax.errors import DvrError

# As version 0.8.1 prints it under a clock that runs a thousand times as fast.
PRINTED = """\
Gauss-Newton system, 2 objects (77 rows): 21345.6 us a slice (10000.0 values, 11345.6 derivatives)
keyframes of length 2, 3012.3 ms a problem in a batch of 50: 2000.0 ms for particles, which prove 17 feasible, \
1012.3 ms for the NLPs of the others, 5 feasible
path NLPs of length 6: median 91234 ms, 17 iterations, 57 of 59 feasible
"""

NAMES = ["Gauss-Newton system, 2 objects", "keyframes of length 2", "path NLPs of length 6"]


def test_lines_of_0_8_1_are_read() -> None:
    times = parse_times(PRINTED)
    assert list(times) == NAMES
    assert list(times.values()) == pytest.approx([21.3456, 3.0123, 91.234])


def test_lines_of_this_version_are_read_and_are_named_as_its_metrics() -> None:
    measured = [
        SliceTimes(objects=2, rows=77, values=0.010, derivatives=0.0113456),
        KeyframeTimes(length=2, problems=50, beam=2.0, nlp=1.0123, proved=17, found=5),
        PathTimes(length=6, problems=59, median=91.234, iterations=17, feasible=57),
    ]
    times = parse_times("\n".join(item.line() for item in measured))
    assert times == parse_times(PRINTED)
    assert [item.metrics()[0].metric for item in measured] == NAMES


def test_least_times_are_of_metrics_that_all_runs_have() -> None:
    before = [{"a": 1.0, "b": 5.0}, {"a": 3.0, "b": 5.0}, {"a": 2.0, "b": 5.0}]
    after = [{"a": 4.0}, {"a": 4.0}, {"a": 8.0}]
    assert compare_least(before, after) == [("a", 1.0, 4.0)]


def test_a_folder_without_the_package_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DvrError, match="valid is a checkout"):
        find_checkout(tmp_path, None)
