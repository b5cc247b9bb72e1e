"""Command line `python -m dvr_jax.plan`: see `dvr_jax.cli.plan`. Imported, it is the function `dvr_jax.plan`."""

if __name__ == "__main__":
    from dvr_jax.cli.console import run_module

    run_module("plan")
elif __name__ == "dvr_jax.plan":
    # The import system binds what stands in sys.modules to the package's name `plan`. That has to stay the function
    # of the public API.
    import sys

    from dvr_jax.planning.planner import plan

    sys.modules[__name__] = plan  # type: ignore[assignment]
