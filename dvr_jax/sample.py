"""Command line `python -m dvr_jax.sample`: see `dvr_jax.cli.sample`."""

if __name__ == "__main__":
    from dvr_jax.cli.console import run_module

    run_module("sample")
