from pathlib import Path

import pytest
from synthetic import OPTIONS, synthetic

from dvr_jax.dataset.shards import Shard, read_shard, write_shard


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two shards of five scenes each, with at most a hundred labels a scene."""
    folder = tmp_path_factory.mktemp("shards")
    for first in (0, 5):
        write_shard(folder / f"{first:06}.parquet", *synthetic(first, first + 5), OPTIONS)
    return folder


@pytest.fixture(scope="session")
def shard(folder: Path) -> Shard:
    return read_shard(folder / "000000.parquet")
