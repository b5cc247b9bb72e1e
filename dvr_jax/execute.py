"""Command line `python -m dvr_jax.execute`: see `dvr_jax.cli.execute`."""

if __name__ == "__main__":
    from dvr_jax.cli.console import run_module

    run_module("execute")
