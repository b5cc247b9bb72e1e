"""Command line `python -m dvr_jax.export`: see `dvr_jax.cli.export`."""

if __name__ == "__main__":
    from dvr_jax.cli.console import run_module

    run_module("export")
