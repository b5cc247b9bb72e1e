"""Command line `python -m dvr_jax.bench NAME`: see `dvr_jax.cli.bench`."""

from dvr_jax.cli.bench import main
from dvr_jax.errors import run_command

if __name__ == "__main__":
    run_command(main)
