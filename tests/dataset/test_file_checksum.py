"""The checksum of a shard's file: whatever byte is changed, the shard is refused in one sentence."""

from pathlib import Path

import pytest

from dvr_jax.dataset.shards import Shard, list_shards, read_shard
from dvr_jax.errors import DvrError


def test_any_byte_may_be_changed(shard: Shard, tmp_path: Path) -> None:
    whole = shard.info.path.read_bytes()
    path = tmp_path / "labels-000000.parquet"
    for place in range(0, len(whole), max(1, len(whole) // 400)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 2]) + whole[place + 1 :])
        with pytest.raises(DvrError, match=r"labels-000000\.parquet is no whole shard"):
            read_shard(path)


def test_any_part_may_be_missing(shard: Shard, tmp_path: Path) -> None:
    whole = shard.info.path.read_bytes()
    path = tmp_path / "labels-000000.parquet"
    for end in range(0, len(whole), max(1, len(whole) // 100)):
        path.write_bytes(whole[:end])
        with pytest.raises(DvrError, match=r"no whole shard"):
            list_shards(tmp_path)


def test_only_a_file_with_a_sweeps_name_may_be_removed(tmp_path: Path) -> None:
    for name, advice in (("labels-000000.parquet", "remove it"), ("mine.parquet", "valid is a")):
        (tmp_path / name).write_bytes(b"something else")
        with pytest.raises(DvrError, match=advice):
            list_shards(tmp_path)
        (tmp_path / name).unlink()
