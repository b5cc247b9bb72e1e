"""Command line `python -m dvr_jax.plan`: see `dvr_jax.cli.plan`. Imported, it is the function `dvr_jax.plan`."""

import sys

from dvr_jax.cli.plan import main
from dvr_jax.errors import run_command

if __name__ == "__main__":
    run_command(main, at_once=True)
elif __name__ == "dvr_jax.plan":
    # The import system binds what stands in sys.modules to the package's name `plan`. That has to stay the function
    # of the public API.
    from dvr_jax.planning.planner import plan

    sys.modules[__name__] = plan  # type: ignore[assignment]
