"""Command line `python -m dvr_jax.sample`: see `dvr_jax.cli.sample`."""

from dvr_jax.cli.sample import main
from dvr_jax.errors import run_command

if __name__ == "__main__":
    run_command(main)
