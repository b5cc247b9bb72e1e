"""The command line of the benchmarks: a list of names, and a sentence for a name that is none."""

import importlib

import pytest

from dvr_jax.cli.bench import BENCHMARKS, main
from dvr_jax.errors import DvrError


def test_the_list_names_all_benchmarks(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    printed = capsys.readouterr().out
    assert all(f"  {name} " in printed for name in BENCHMARKS)


def test_every_benchmark_has_a_command() -> None:
    for benchmark in BENCHMARKS.values():
        assert callable(importlib.import_module(f"dvr_jax.bench.{benchmark.module}").run)


def test_other_names_are_refused() -> None:
    with pytest.raises(DvrError, match="no benchmark 'nix'; valid: table1, "):
        main(["nix"])
