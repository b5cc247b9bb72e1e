"""Command line `python -m dvr_jax.bench NAME`: see `dvr_jax.cli.bench`."""

if __name__ == "__main__":
    from dvr_jax.cli.console import run_module

    run_module("bench")
