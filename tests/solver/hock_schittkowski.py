"""Problems of the Hock-Schittkowski collection whose objective is a sum of squares, with their published optima.

W. Hock and K. Schittkowski, Test Examples for Nonlinear Programming Codes, Springer 1981. Quadratic objectives were
completed to squares. Fourth powers are squares of squares. Left out are 2 and 20, whose starts lie beside another local
minimum. Functions take the variables one by one and work on numbers of NumPy and of JAX."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, sqrt
from typing import Any

import jax.numpy as jnp
import numpy as np

ConstraintValues = tuple[Any, ...]


def _none(*_x: Any) -> ConstraintValues:
    return ()


@dataclass(frozen=True)
class Example:
    """Minimize ``scale * sum(residuals^2) + constant``, where equalities are 0, inequalities at most 0 and variables
    within their bounds."""

    number: int
    start: tuple[float, ...]
    residuals: Callable[..., ConstraintValues]
    optimum: float
    """Published least objective."""
    scale: float = 1.0
    constant: float = 0.0
    equalities: Callable[..., ConstraintValues] = _none
    inequalities: Callable[..., ConstraintValues] = _none
    lower: tuple[float, ...] = ()
    """Bounds of each variable; empty where none has any."""
    upper: tuple[float, ...] = ()

    def rows(self, *x: Any) -> ConstraintValues:
        """Inequalities, then finite bounds, each at most 0."""
        below = [bound - value for value, bound in zip(x, self.lower, strict=False) if bound > -inf]
        above = [value - bound for value, bound in zip(x, self.upper, strict=False) if bound < inf]
        return (*self.inequalities(*x), *below, *above)


def _sin(a: Any) -> Any:
    return (np if isinstance(a, float) else jnp).sin(a)


def _exp(a: Any) -> Any:
    return (np if isinstance(a, float) else jnp).exp(a)


def _rosenbrock(x1: Any, x2: Any) -> ConstraintValues:
    return 10 * (x2 - x1**2), 1 - x1


_COLLECTION = (
    Example(1, (-2.0, 1.0), _rosenbrock, 0.0, lower=(-inf, -1.5)),
    Example(
        6,
        (-1.2, 1.0),
        lambda x1, x2: (1 - x1,),
        0.0,
        equalities=lambda x1, x2: (10 * (x2 - x1**2),),
    ),
    Example(
        11,
        (4.9, 0.1),
        lambda x1, x2: (x1 - 5, x2),
        -8.498464223,
        constant=-25.0,
        inequalities=lambda x1, x2: (x1**2 - x2,),
    ),
    Example(
        12,
        (0.0, 0.0),
        # 1/2 x1^2 + x2^2 - x1 x2 - 7 x1 - 7 x2 has its least value at (21, 14).
        lambda x1, x2: (x1 - x2 - 7, x2 - 14),
        -30.0,
        scale=0.5,
        constant=-122.5,
        inequalities=lambda x1, x2: (4 * x1**2 + x2**2 - 25,),
    ),
    Example(
        14,
        (2.0, 2.0),
        lambda x1, x2: (x1 - 2, x2 - 1),
        9 - 2.875 * sqrt(7),
        equalities=lambda x1, x2: (x1 - 2 * x2 + 1,),
        inequalities=lambda x1, x2: (0.25 * x1**2 + x2**2 - 1,),
    ),
    Example(
        15,
        (-2.0, 1.0),
        _rosenbrock,
        306.5,
        inequalities=lambda x1, x2: (1 - x1 * x2, -x1 - x2**2),
        upper=(0.5, inf),
    ),
    Example(
        16,
        (-2.0, 1.0),
        _rosenbrock,
        0.25,
        inequalities=lambda x1, x2: (-x1 - x2**2, -(x1**2) - x2),
        lower=(-0.5, -inf),
        upper=(0.5, 1.0),
    ),
    Example(
        17,
        (-2.0, 1.0),
        _rosenbrock,
        1.0,
        inequalities=lambda x1, x2: (x1 - x2**2, x2 - x1**2),
        lower=(-0.5, -inf),
        upper=(0.5, 1.0),
    ),
    Example(
        18,
        (2.0, 2.0),
        lambda x1, x2: (0.1 * x1, x2),
        5.0,
        inequalities=lambda x1, x2: (25 - x1 * x2, 25 - x1**2 - x2**2),
        lower=(2.0, 0.0),
        upper=(50.0, 50.0),
    ),
    Example(
        21,
        (-1.0, -1.0),
        lambda x1, x2: (0.1 * x1, x2),
        -99.96,
        constant=-100.0,
        inequalities=lambda x1, x2: (10 - 10 * x1 + x2,),
        lower=(2.0, -50.0),
        upper=(50.0, 50.0),
    ),
    Example(
        22,
        (2.0, 2.0),
        lambda x1, x2: (x1 - 2, x2 - 1),
        1.0,
        inequalities=lambda x1, x2: (x1 + x2 - 2, x1**2 - x2),
    ),
    Example(
        23,
        (3.0, 1.0),
        lambda x1, x2: (x1, x2),
        2.0,
        inequalities=lambda x1, x2: (
            1 - x1 - x2,
            1 - x1**2 - x2**2,
            9 - 9 * x1**2 - x2**2,
            x2 - x1**2,
            x1 - x2**2,
        ),
        lower=(-50.0, -50.0),
        upper=(50.0, 50.0),
    ),
    Example(
        26,
        (-2.6, 2.0, 2.0),
        lambda x1, x2, x3: (x1 - x2, (x2 - x3) ** 2),
        0.0,
        equalities=lambda x1, x2, x3: ((1 + x2**2) * x1 + x3**4 - 3,),
    ),
    Example(
        27,
        (2.0, 2.0, 2.0),
        lambda x1, x2, x3: (0.1 * (x1 - 1), x2 - x1**2),
        0.04,
        equalities=lambda x1, x2, x3: (x1 + x3**2 + 1,),
    ),
    Example(
        28,
        (-4.0, 1.0, 1.0),
        lambda x1, x2, x3: (x1 + x2, x2 + x3),
        0.0,
        equalities=lambda x1, x2, x3: (x1 + 2 * x2 + 3 * x3 - 1,),
    ),
    Example(
        30,
        (1.0, 1.0, 1.0),
        lambda x1, x2, x3: (x1, x2, x3),
        1.0,
        inequalities=lambda x1, x2, x3: (1 - x1**2 - x2**2,),
        lower=(1.0, -10.0, -10.0),
        upper=(10.0, 10.0, 10.0),
    ),
    Example(
        31,
        (1.0, 1.0, 1.0),
        lambda x1, x2, x3: (3 * x1, x2, 3 * x3),
        6.0,
        inequalities=lambda x1, x2, x3: (1 - x1 * x2,),
        lower=(-10.0, 1.0, -10.0),
        upper=(10.0, 10.0, 1.0),
    ),
    Example(
        32,
        (0.1, 0.7, 0.2),
        lambda x1, x2, x3: (x1 + 3 * x2 + x3, 2 * (x1 - x2)),
        1.0,
        equalities=lambda x1, x2, x3: (1 - x1 - x2 - x3,),
        inequalities=lambda x1, x2, x3: (x1**3 - 6 * x2 - 4 * x3 + 3,),
        lower=(0.0, 0.0, 0.0),
    ),
    Example(
        35,
        (0.5, 0.5, 0.5),
        # The quadratic objective is 0 at (1, 1, 1).
        lambda x1, x2, x3: (x1 + x3 - 2, x1 + x2 - 2, x2 - 1),
        1 / 9,
        inequalities=lambda x1, x2, x3: (x1 + x2 + 2 * x3 - 3,),
        lower=(0.0, 0.0, 0.0),
    ),
    Example(
        38,
        (-3.0, -1.0, -3.0, -1.0),
        # 10.1 (a^2 + b^2) + 19.8 a b = 10 (a + b)^2 + 0.1 (a - b)^2 with a = x2 - 1, b = x4 - 1.
        lambda x1, x2, x3, x4: (
            10 * (x2 - x1**2),
            1 - x1,
            sqrt(90) * (x4 - x3**2),
            1 - x3,
            sqrt(10) * (x2 + x4 - 2),
            sqrt(0.1) * (x2 - x4),
        ),
        0.0,
        lower=(-10.0,) * 4,
        upper=(10.0,) * 4,
    ),
    Example(
        42,
        (1.0, 1.0, 1.0, 1.0),
        lambda x1, x2, x3, x4: (x1 - 1, x2 - 2, x3 - 3, x4 - 4),
        28 - 10 * sqrt(2),
        equalities=lambda x1, x2, x3, x4: (x1 - 2, x3**2 + x4**2 - 2),
    ),
    Example(
        43,
        (0.0, 0.0, 0.0, 0.0),
        # x1^2 + x2^2 + 2 x3^2 + x4^2 - 5 x1 - 5 x2 - 21 x3 + 7 x4
        lambda x1, x2, x3, x4: (x1 - 2.5, x2 - 2.5, sqrt(2) * (x3 - 5.25), x4 + 3.5),
        -44.0,
        constant=-79.875,
        inequalities=lambda x1, x2, x3, x4: (
            x1**2 + x2**2 + x3**2 + x4**2 + x1 - x2 + x3 - x4 - 8,
            x1**2 + 2 * x2**2 + x3**2 + 2 * x4**2 - x1 - x4 - 10,
            2 * x1**2 + x2**2 + x3**2 + 2 * x1 - x2 - x4 - 5,
        ),
    ),
    Example(
        46,
        (sqrt(2) / 2, 1.75, 0.5, 2.0, 2.0),
        lambda x1, x2, x3, x4, x5: (x1 - x2, x3 - 1, (x4 - 1) ** 2, (x5 - 1) ** 3),
        0.0,
        equalities=lambda x1, x2, x3, x4, x5: (
            x1**2 * x4 + _sin(x4 - x5) - 1,
            x2 + x3**4 * x4**2 - 2,
        ),
    ),
    Example(
        48,
        (3.0, 5.0, -3.0, 2.0, -2.0),
        lambda x1, x2, x3, x4, x5: (x1 - 1, x2 - x3, x4 - x5),
        0.0,
        equalities=lambda x1, x2, x3, x4, x5: (x1 + x2 + x3 + x4 + x5 - 5, x3 - 2 * (x4 + x5) + 3),
    ),
    Example(
        49,
        (10.0, 7.0, 2.0, -3.0, 0.8),
        lambda x1, x2, x3, x4, x5: (x1 - x2, x3 - 1, (x4 - 1) ** 2, (x5 - 1) ** 3),
        0.0,
        equalities=lambda x1, x2, x3, x4, x5: (x1 + x2 + x3 + 4 * x4 - 7, x3 + 5 * x5 - 6),
    ),
    Example(
        50,
        (35.0, -31.0, 11.0, 5.0, -5.0),
        lambda x1, x2, x3, x4, x5: (x1 - x2, x2 - x3, (x3 - x4) ** 2, x4 - x5),
        0.0,
        equalities=lambda x1, x2, x3, x4, x5: (
            x1 + 2 * x2 + 3 * x3 - 6,
            x2 + 2 * x3 + 3 * x4 - 6,
            x3 + 2 * x4 + 3 * x5 - 6,
        ),
    ),
    Example(
        51,
        (2.5, 0.5, 2.0, -1.0, 0.5),
        lambda x1, x2, x3, x4, x5: (x1 - x2, x2 + x3 - 2, x4 - 1, x5 - 1),
        0.0,
        equalities=lambda x1, x2, x3, x4, x5: (x1 + 3 * x2 - 4, x3 + x4 - 2 * x5, x2 - x5),
    ),
    Example(
        52,
        (2.0,) * 5,
        lambda x1, x2, x3, x4, x5: (4 * x1 - x2, x2 + x3 - 2, x4 - 1, x5 - 1),
        1859 / 349,
        equalities=lambda x1, x2, x3, x4, x5: (x1 + 3 * x2, x3 + x4 - 2 * x5, x2 - x5),
    ),
    Example(
        53,
        (2.0,) * 5,
        lambda x1, x2, x3, x4, x5: (x1 - x2, x2 + x3 - 2, x4 - 1, x5 - 1),
        176 / 43,
        equalities=lambda x1, x2, x3, x4, x5: (x1 + 3 * x2, x3 + x4 - 2 * x5, x2 - x5),
        lower=(-10.0,) * 5,
        upper=(10.0,) * 5,
    ),
    Example(
        60,
        (2.0,) * 3,
        lambda x1, x2, x3: (x1 - 1, x1 - x2, (x2 - x3) ** 2),
        0.03256820025,
        equalities=lambda x1, x2, x3: (x1 * (1 + x2**2) + x3**4 - 4 - 3 * sqrt(2),),
        lower=(-10.0,) * 3,
        upper=(10.0,) * 3,
    ),
    Example(
        61,
        (0.0,) * 3,
        # 4 x1^2 + 2 x2^2 + 2 x3^2 - 33 x1 + 16 x2 - 24 x3
        lambda x1, x2, x3: (2 * (x1 - 4.125), sqrt(2) * (x2 + 4), sqrt(2) * (x3 - 6)),
        -143.6461422,
        constant=-172.0625,
        equalities=lambda x1, x2, x3: (3 * x1 - 2 * x2**2 - 7, 4 * x1 - x3**2 - 11),
    ),
    Example(
        65,
        (-5.0, 5.0, 0.0),
        lambda x1, x2, x3: (x1 - x2, (x1 + x2 - 10) / 3, x3 - 5),
        0.9535288567,
        inequalities=lambda x1, x2, x3: (x1**2 + x2**2 + x3**2 - 48,),
        lower=(-4.5, -4.5, -5.0),
        upper=(4.5, 4.5, 5.0),
    ),
    Example(
        76,
        (0.5,) * 4,
        # x1^2 + x2^2 / 2 + x3^2 + x4^2 / 2 - x1 x3 + x3 x4 - x1 - 3 x2 + x3 - x4 has its least value at (-1, 3, -3, 4).
        lambda x1, x2, x3, x4: (
            x1 - x3 / 2 - 0.5,
            (x3 + 3) / 2,
            sqrt(0.5) * (x3 + x4 - 1),
            sqrt(0.5) * (x2 - 3),
        ),
        -4.681818182,
        constant=-7.5,
        inequalities=lambda x1, x2, x3, x4: (
            x1 + 2 * x2 + x3 + x4 - 5,
            3 * x1 + x2 + 2 * x3 - x4 - 4,
            1.5 - x2 - 4 * x3,
        ),
        lower=(0.0,) * 4,
    ),
    Example(
        77,
        (2.0,) * 5,
        lambda x1, x2, x3, x4, x5: (x1 - 1, x1 - x2, x3 - 1, (x4 - 1) ** 2, (x5 - 1) ** 3),
        0.24150513,
        equalities=lambda x1, x2, x3, x4, x5: (
            x1**2 * x4 + _sin(x4 - x5) - 2 * sqrt(2),
            x2 + x3**4 * x4**2 - 8 - sqrt(2),
        ),
    ),
    Example(
        79,
        (2.0,) * 5,
        lambda x1, x2, x3, x4, x5: (x1 - 1, x1 - x2, x2 - x3, (x3 - x4) ** 2, (x4 - x5) ** 2),
        0.0787768209,
        equalities=lambda x1, x2, x3, x4, x5: (
            x1 + x2**2 + x3**3 - 2 - 3 * sqrt(2),
            x2 - x3**2 + x4 + 2 - 2 * sqrt(2),
            x1 * x5 - 2,
        ),
    ),
    Example(
        80,
        (-2.0, 2.0, 2.0, -1.0, -1.0),
        # exp(x1 x2 x3 x4 x5) is the square of the root of it.
        lambda x1, x2, x3, x4, x5: (_exp(0.5 * x1 * x2 * x3 * x4 * x5),),
        0.0539498478,
        equalities=lambda x1, x2, x3, x4, x5: (
            x1**2 + x2**2 + x3**2 + x4**2 + x5**2 - 10,
            x2 * x3 - 5 * x4 * x5,
            x1**3 + x2**3 + 1,
        ),
        lower=(-2.3, -2.3, -3.2, -3.2, -3.2),
        upper=(2.3, 2.3, 3.2, 3.2, 3.2),
    ),
    Example(
        113,
        (2.0, 3.0, 5.0, 5.0, 1.0, 2.0, 7.0, 3.0, 6.0, 10.0),
        # x1^2 + x2^2 + x1 x2 - 14 x1 - 16 x2 has its least value -76 at (4, 6).
        lambda x1, x2, x3, x4, x5, x6, x7, x8, x9, x10: (
            x1 + x2 / 2 - 7,
            sqrt(0.75) * (x2 - 6),
            x3 - 10,
            2 * (x4 - 5),
            x5 - 3,
            sqrt(2) * (x6 - 1),
            sqrt(5) * x7,
            sqrt(7) * (x8 - 11),
            sqrt(2) * (x9 - 10),
            x10 - 7,
        ),
        24.3062091,
        constant=-31.0,
        inequalities=lambda x1, x2, x3, x4, x5, x6, x7, x8, x9, x10: (
            4 * x1 + 5 * x2 - 3 * x7 + 9 * x8 - 105,
            10 * x1 - 8 * x2 - 17 * x7 + 2 * x8,
            -8 * x1 + 2 * x2 + 5 * x9 - 2 * x10 - 12,
            3 * (x1 - 2) ** 2 + 4 * (x2 - 3) ** 2 + 2 * x3**2 - 7 * x4 - 120,
            5 * x1**2 + 8 * x2 + (x3 - 6) ** 2 - 2 * x4 - 40,
            0.5 * (x1 - 8) ** 2 + 2 * (x2 - 4) ** 2 + 3 * x5**2 - x6 - 30,
            x1**2 + 2 * (x2 - 2) ** 2 - 2 * x1 * x2 + 14 * x5 - 6 * x6,
            -3 * x1 + 6 * x2 + 12 * (x9 - 8) ** 2 - 7 * x10,
        ),
    ),
)

EXAMPLES = {example.number: example for example in _COLLECTION}
"""By the number of the collection."""
