"""The table of compiled programs: their times are those of the three steps, and its last line sums them up."""

import jax.numpy as jnp
import numpy as np

from dvr_jax.bench.startup import table
from dvr_jax.runtime.compile_times import CompileTimes, compile_program, compile_times


def test_a_compiled_program_is_noted_with_its_shapes_and_times() -> None:
    def double(values: dict[str, np.ndarray]) -> np.ndarray:
        return 2 * values["a"] + values["b"]

    before = len(compile_times())
    given = {"a": np.ones((2, 3), np.float32), "b": np.float32(1)}
    compiled = compile_program(double, (given,), {})
    np.testing.assert_array_equal(compiled(given), np.full((2, 3), 3))

    (noted,) = compile_times()[before:]
    assert noted.name.endswith("double") and noted.shapes == ((2, 3),)
    assert min(noted.tracing, noted.lowering, noted.compiling) > 0
    assert jnp.asarray(compiled(given)).dtype == jnp.float32


def test_the_table_is_in_the_order_of_the_beginnings_and_ends_with_the_sums() -> None:
    later = CompileTimes("solver.step", ((4,), (5, 6)), 12.0, 0.25, 0.5, 4.0)
    earlier = CompileTimes("seeds.reach", (), 11.0, 0.5, 0.25, 1.0)
    _, first, second, last = table([later, earlier], begin=10.0)
    assert first.split()[:4] == ["1.0", "0.50", "0.25", "1.00"] and "seeds.reach" in first
    assert second.split()[0] == "2.0" and second.endswith("solver.step, 5 x 6")
    assert last.split() == ["all", "0.75", "0.75", "5.00", "2", "programs"]


def test_a_plan_that_compiles_nothing_has_an_empty_table() -> None:
    assert table([], begin=0.0)[-1].split()[-2:] == ["0", "programs"]
