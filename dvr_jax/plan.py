"""Command line `python -m dvr_jax.plan`: see `dvr_jax.cli.plan`."""

from dvr_jax.cli.plan import main
from dvr_jax.errors import run_command

if __name__ == "__main__":
    run_command(main, at_once=True)
