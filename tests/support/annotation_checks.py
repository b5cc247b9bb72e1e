"""What checks the annotations of the package while its tests run (`tests/conftest.py`)."""

from typing import Any

from beartype import BeartypeConf, beartype

_check_function = beartype(conf=BeartypeConf(is_pep484_tower=True))


def check(function: Any) -> Any:
    """Check the annotations of a function whenever it is called; as for static checkers, an int is a float too.

    Records are not checked: wrong values in them are refused where they enter the package, which tests try; and JAX
    makes pytrees whose leaves are no arrays.
    """
    if getattr(function, "__name__", "") == "__init__":
        return function
    return _check_function(function)
