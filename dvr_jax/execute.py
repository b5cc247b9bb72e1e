"""Command line `python -m dvr_jax.execute`: see `dvr_jax.cli.execute`."""

from dvr_jax.cli.execute import main
from dvr_jax.errors import run_command

if __name__ == "__main__":
    run_command(main)
