"""Command line `python -m dvr_jax.sweep`: see `dvr_jax.cli.sweep`."""

if __name__ == "__main__":
    from dvr_jax.cli.console import run_module

    run_module("sweep")
