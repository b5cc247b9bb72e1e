"""A library that imports matplotlib is imported without it, and still draws with it."""

import subprocess
import sys

CODE = """
import sys
from dvr_jax.motion import path_parameter
assert "matplotlib" not in sys.modules
assert path_parameter.toppra.SplineInterpolator

from toppra import parametrizer
import matplotlib
matplotlib.use("Agg")
assert matplotlib.__version__
parametrizer.plt.figure()
import matplotlib.pyplot
assert parametrizer.plt.gcf() is matplotlib.pyplot.gcf()
"""


def test_matplotlib_is_imported_when_something_is_drawn() -> None:
    subprocess.run([sys.executable, "-c", CODE], check=True)
