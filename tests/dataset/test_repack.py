"""Repacking: shards of the first layout are read, and are written anew with the same rows and footers."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from first_layout_file import write_first_layout

from dvr_jax.dataset import repack
from dvr_jax.dataset.examples import load_examples
from dvr_jax.dataset.folder_manifest import write_manifest
from dvr_jax.dataset.repack import repack_folder
from dvr_jax.dataset.shards import Shard, list_shards, read_columns, read_shard, same_rows
from dvr_jax.errors import DvrError


@pytest.fixture
def shards(folder: Path) -> list[Shard]:
    return [read_shard(info.path) for info in list_shards(folder)]


@pytest.fixture
def old_folder(shards: list[Shard], tmp_path: Path) -> Path:
    """The shards of `folder` in the first layout, made by another version, and their manifest."""
    for shard in shards:
        versions = shard.info.footer.versions | {"dvr_jax": "0.4.0", "numpy": "1.0"}
        footer = msgspec.structs.replace(shard.info.footer, versions=versions, checksum="")
        write_first_layout(
            tmp_path / shard.info.path.name, replace(shard, info=replace(shard.info, footer=footer))
        )
    write_manifest(tmp_path, command=["python", "-m", "dvr_jax.sweep"])
    return tmp_path


def test_the_first_layout_is_read(old_folder: Path, folder: Path, shards: list[Shard]) -> None:
    for info, shard in zip(list_shards(old_folder), shards, strict=True):
        assert info.footer.schema == 1
        assert same_rows(read_shard(info.path), shard)
    old = load_examples(old_folder)
    new = load_examples(folder)
    assert old.scenes == new.scenes
    for name in ("scene", "actions", "targets", "weight", "refuted_after", "length", "feasible"):
        assert (getattr(old, name) == getattr(new, name)).all()


def test_repacking_keeps_rows_footers_and_manifest(old_folder: Path, shards: list[Shard]) -> None:
    before = {info.path.name: info.footer for info in list_shards(old_folder)}
    manifest_before = json.loads((old_folder / "_manifest.json").read_text())
    files_before = {path.name for path in old_folder.iterdir()}

    repacked = list(repack_folder(old_folder))
    assert [shard.info for shard in repacked] == list_shards(old_folder)
    assert {path.name for path in old_folder.iterdir()} == files_before
    for shard, own in zip(repacked, shards, strict=True):
        assert shard.bytes_after == shard.info.path.stat().st_size < shard.bytes_before
        assert same_rows(read_shard(shard.info.path), own)
        assert shard.info.footer == msgspec.structs.replace(
            before[shard.info.path.name], schema=2, checksum="sha256"
        )
        assert shard.info.footer.versions["dvr_jax"] == "0.4.0"

    manifest = json.loads((old_folder / "_manifest.json").read_text())
    for entry in manifest["shards"]:
        assert (
            entry["sha256"] == hashlib.sha256((old_folder / entry["file"]).read_bytes()).hexdigest()
        )
    assert manifest["shards"] != manifest_before["shards"]
    for entry in manifest["shards"] + manifest_before["shards"]:
        del entry["sha256"]
    assert manifest == manifest_before


def test_repacking_twice_changes_nothing(old_folder: Path) -> None:
    list(repack_folder(old_folder))
    before = {path.name: path.read_bytes() for path in old_folder.iterdir()}
    list(repack_folder(old_folder))
    assert {path.name: path.read_bytes() for path in old_folder.iterdir()} == before


def test_a_folder_without_manifest_gets_none(old_folder: Path) -> None:
    (old_folder / "_manifest.json").unlink()
    assert len(list(repack_folder(old_folder))) == 2
    assert not (old_folder / "_manifest.json").exists()


def test_a_loss_is_refused(old_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = {path.name: path.read_bytes() for path in old_folder.iterdir()}

    def lossy(info: object) -> object:
        columns = read_columns(info)  # type: ignore[arg-type]
        return replace(columns, violation=columns.violation * 2)

    monkeypatch.setattr(repack, "read_columns", lossy)
    with pytest.raises(
        DvrError, match=r"000000\.parquet cannot be repacked without loss; it stays as it is"
    ):
        list(repack_folder(old_folder))
    assert {path.name: path.read_bytes() for path in old_folder.iterdir()} == before


def test_bad_requests(old_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(DvrError, match="there is no folder"):
        list(repack_folder(tmp_path / "missing"))
    (tmp_path / "empty").mkdir()
    with pytest.raises(DvrError, match="there is no shard in"):
        list(repack_folder(tmp_path / "empty"))
    (old_folder / "_manifest.json").write_text("{")
    with pytest.raises(DvrError, match=r"_manifest\.json is no JSON"):
        list(repack_folder(old_folder))


def test_a_missing_value_of_the_first_layout_is_refused(old_folder: Path) -> None:
    path = old_folder / "000000.parquet"
    table = pq.read_table(path)
    nothing = pa.array([None] * len(table), pa.string())
    pq.write_table(
        table.set_column(1, "json", nothing).replace_schema_metadata(table.schema.metadata), path
    )
    with pytest.raises(DvrError, match="is no whole shard"):
        read_shard(path)
