"""Command line `python -m dvr_jax.export`: see `dvr_jax.cli.export`."""

from dvr_jax.cli.export import main
from dvr_jax.errors import run_command

if __name__ == "__main__":
    run_command(main)
