"""The command line of the data set: counts beside the paper's, and repacking."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from first_layout_file import write_first_layout
from synthetic import OPTIONS, synthetic

from dvr_jax.dataset.shards import list_shards, read_shard, same_rows, write_shard


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shards")
    for first in (0, 5):
        write_shard(folder / f"{first:06}.parquet", *synthetic(first, first + 5), OPTIONS)
    return folder


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "dvr_jax.dataset", *map(str, arguments)],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": os.getcwd()},
        check=False,
    )


def test_counts(folder: Path, tmp_path: Path) -> None:
    counted = run(folder)
    assert (counted.returncode, counted.stderr) == (0, "")
    assert all(
        number in counted.stdout
        for number in ("25,736", "102,566", "2,741,573", "1,803,684", "7,926,696")
    )
    nothing = run(tmp_path)
    assert nothing.returncode == 2
    assert (
        nothing.stderr.startswith("error: there is no shard in") and nothing.stderr.count("\n") == 1
    )


def test_repack(folder: Path, tmp_path: Path) -> None:
    for info in list_shards(folder):
        write_first_layout(tmp_path / info.path.name, read_shard(info.path))
    before = sum(info.path.stat().st_size for info in list_shards(tmp_path))
    repacked = run("repack", tmp_path)
    after = sum(info.path.stat().st_size for info in list_shards(tmp_path))
    assert (repacked.returncode, repacked.stderr) == (0, "")
    assert repacked.stdout == (
        f"{tmp_path}: 10 scenes, {before:,} bytes before and {after:,} after, {after / 10:.0f} bytes a scene\n"
    )
    for old, new in zip(list_shards(folder), list_shards(tmp_path), strict=True):
        assert old.path.read_bytes() == new.path.read_bytes()
        assert same_rows(read_shard(old.path), read_shard(new.path))
    assert run("repack", tmp_path / "missing").stderr.startswith("error: there is no folder")
