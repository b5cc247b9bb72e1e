"""Command line `python -m dvr_jax.train`: see `dvr_jax.cli.train`."""

if __name__ == "__main__":
    from dvr_jax.cli.console import run_module

    run_module("train")
