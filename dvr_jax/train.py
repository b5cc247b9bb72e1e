"""Command line `python -m dvr_jax.train`: see `dvr_jax.cli.train`."""

from dvr_jax.cli.train import main
from dvr_jax.errors import run_command

if __name__ == "__main__":
    run_command(main)
