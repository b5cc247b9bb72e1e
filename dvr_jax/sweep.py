"""Command line `python -m dvr_jax.sweep`: see `dvr_jax.cli.sweep`."""

from dvr_jax.cli.sweep import main
from dvr_jax.errors import run_command

if __name__ == "__main__":
    run_command(main)
