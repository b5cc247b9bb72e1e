"""Command line `python -m dvr_jax.dataset`: see `dvr_jax.cli.dataset`."""

if __name__ == "__main__":
    from dvr_jax.cli.console import run_module

    run_module("dataset")
