"""Command line `python -m dvr_jax.dataset`: see `dvr_jax.cli.dataset`."""

from dvr_jax.cli.dataset import main
from dvr_jax.errors import run_command

if __name__ == "__main__":
    run_command(main)
