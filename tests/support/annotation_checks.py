"""What checks the annotations of the package while its tests run (`tests/conftest.py`)."""

from beartype import BeartypeConf, beartype

check = beartype(conf=BeartypeConf(is_pep484_tower=True))
"""Decorator for functions and classes; as for static checkers, an int is a float too."""
