"""Shards: round trip, order, size, and what happens to killed writers and broken, foreign or overlapping files."""

import json
import os
import random
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic import OPTIONS, synthetic

from dvr_jax.dataset.columns import VIOLATION_BITS, round_violation
from dvr_jax.dataset.labels import Label, same_label
from dvr_jax.dataset.shards import (
    KEY,
    Shard,
    find_shards,
    list_shards,
    read_shard,
    same_rows,
    write_shard,
)
from dvr_jax.errors import DvrError


def rounded(label: Label) -> Label:
    return replace(label, violation=round_violation(label.violation))


def test_round_trip(shard: Shard) -> None:
    scenes, labels = synthetic(0, 5)
    key = lambda label: (label.scene, len(label.actions), label.actions)  # noqa: E731
    assert shard.scenes == tuple(scenes.values())
    assert all(map(same_label, shard.labels, sorted(map(rounded, labels), key=key)))
    assert len(shard.labels) == len(labels) == 449
    footer = shard.info.footer
    assert (footer.first, footer.stop, footer.labels, footer.options) == (0, 5, 449, OPTIONS)
    assert footer.seeds == {"seed": 1}
    assert {"dvr_jax", "jax", "python"} <= set(footer.versions)


def test_scenes_without_labels_are_kept(tmp_path: Path) -> None:
    scenes, labels = synthetic(0, 4, rows=10)
    for kept in ([label for label in labels if label.scene == 2], []):
        info = write_shard(tmp_path / "a.parquet", scenes, kept, OPTIONS)
        again = read_shard(info.path)
        assert (again.info.scenes, again.scenes) == (range(4), tuple(scenes.values()))
        assert [label.actions for label in again.labels] == sorted(
            (x.actions for x in kept), key=lambda a: (len(a), a)
        )


def test_equal_sweeps_give_equal_files(tmp_path: Path, shard: Shard) -> None:
    scenes, labels = synthetic(0, 5)
    random.Random(0).shuffle(labels)
    info = write_shard(
        tmp_path / "a.parquet",
        dict(reversed(scenes.items())),
        labels,
        dict(reversed(OPTIONS.items())),
    )
    assert info.path.read_bytes() == shard.info.path.read_bytes()
    assert same_rows(read_shard(info.path), shard)


def test_same_rows_sees_every_difference(shard: Shard) -> None:
    label = next(label for label in shard.labels if not np.isnan(label.violation))
    others = [
        replace(label, feasible=not label.feasible),
        replace(label, bound="check"),
        replace(label, violation=label.violation * 1.01),
        replace(label, violation=np.nan),
        replace(label, refuted_prefix=not label.refuted_prefix),
        replace(label, actions=label.actions[:-1]),
        replace(label, scene=label.scene + 1),
    ]
    for other in others:
        changed = tuple(other if kept is label else kept for kept in shard.labels)
        assert not same_rows(shard, replace(shard, labels=changed))
    assert not same_rows(shard, replace(shard, labels=shard.labels[:-1]))
    assert not same_rows(shard, replace(shard, scenes=shard.scenes[::-1]))
    other_sweep = msgspec.structs.replace(shard.info.footer, options={"seed": 2})
    assert same_rows(shard, replace(shard, info=replace(shard.info, footer=other_sweep)))


def test_bytes_per_row(tmp_path: Path) -> None:
    """A hundred scenes of a hundred labels: five bytes a label at most, the scenes included.

    Nearly two of these are violations, which are all different here; in a real sweep most labels share theirs.
    """
    scenes, labels = synthetic(0, 100)
    info = write_shard(tmp_path / "a.parquet", scenes, labels, OPTIONS)
    assert info.path.stat().st_size < 5 * len(labels)


def test_bytes_per_scene_of_the_shipped_labels() -> None:
    """At most 450 bytes for a scene with all its labels."""
    infos = find_shards([Path("data/labels") / name for name in ("train", "more", "third")])
    assert sum(len(info.scenes) for info in infos) == 30_000
    assert sum(info.path.stat().st_size for info in infos) < 450 * 30_000


@given(st.floats(1e-30, 1e30) | st.sampled_from([0.0, np.inf, np.nan]))
def test_violations_keep_three_digits(violation: float) -> None:
    kept = round_violation(violation)
    assert np.isclose(kept, violation, rtol=2.0**-VIOLATION_BITS, atol=0, equal_nan=True)
    assert np.isnan(kept) or round_violation(kept) == kept == float(np.float32(kept))


WRITER = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from synthetic import OPTIONS, synthetic
from dvr_jax.dataset.shards import write_shard
def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)
os.{when} = die
write_shard({path!r}, *synthetic(0, 2, rows=5), OPTIONS)
"""


@pytest.mark.parametrize("when", ["fsync", "replace"])
def test_a_killed_writer_leaves_no_half_shard(when: str, tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    write_shard(path, *synthetic(0, 1, rows=5), OPTIONS)
    before = path.read_bytes()
    program = WRITER.format(
        tests=str(Path(__file__).parents[1] / "support"), path=str(path), when=when
    )
    environment = os.environ | {"PYTHONPATH": os.getcwd()}
    ended = subprocess.run(
        [sys.executable, "-c", program], timeout=60, env=environment, check=False
    )
    assert ended.returncode == -signal.SIGKILL
    assert path.read_bytes() == before
    assert [info.path for info in list_shards(tmp_path)] == [path]


def test_a_full_disk_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_shard(tmp_path / "a.parquet", *synthetic(0, 1, rows=5), OPTIONS)
    assert list(tmp_path.iterdir()) == []


def test_no_flipped_bit_changes_a_label(tmp_path: Path) -> None:
    """A bit flipped anywhere is refused, or has hit what carries no label (versions, options, statistics)."""
    path = write_shard(tmp_path / "a.parquet", *synthetic(0, 2, rows=10), OPTIONS).path
    content, whole, generator, refused = path.read_bytes(), read_shard(path), random.Random(0), 0
    places = range(0, len(content), 7)
    for place in places:
        flipped = bytearray(content)
        flipped[place] ^= 1 << generator.randrange(8)
        path.write_bytes(flipped)
        try:
            assert same_rows(read_shard(path), whole)
        except DvrError as error:
            assert str(path) in str(error)
            refused += 1
    assert refused > len(places) / 2


@pytest.mark.parametrize("cut", [0, 3, 100, -1])
def test_a_cut_file_is_refused(cut: int, tmp_path: Path, shard: Shard) -> None:
    path = tmp_path / "a.parquet"
    path.write_bytes(shard.info.path.read_bytes()[:cut])
    for read in (lambda: read_shard(path), lambda: list_shards(tmp_path)):
        with pytest.raises(DvrError, match=r"a\.parquet is no whole shard"):
            read()


def test_foreign_files_are_refused(tmp_path: Path, shard: Shard) -> None:
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"x": [1, 2]}), path)
    with pytest.raises(DvrError, match=r"a\.parquet is a Parquet file, but no shard of labels"):
        list_shards(tmp_path)
    table = pq.read_table(shard.info.path)
    footer = json.loads(table.schema.metadata[KEY])
    # As shards were before version 0.10: every one of these files would else lack its checksum.
    assert footer.pop("checksum") == "sha256"
    table = table.replace_schema_metadata({KEY: json.dumps(footer)})
    for changes, message in (
        ({"schema": 3}, "schema version 3; valid are 1 and 2"),
        ({"schema": 0}, "schema version 0; valid are 1 and 2"),
        ({"domain": "0123"}, "another symbolic domain"),
        ({"first": "none"}, "broken footer"),
        ({"versions": {}}, "broken footer"),
    ):
        pq.write_table(table.replace_schema_metadata({KEY: json.dumps(footer | changes)}), path)
        with pytest.raises(DvrError, match=message):
            list_shards(tmp_path)
    pq.write_table(table.slice(0, 3).replace_schema_metadata({KEY: json.dumps(footer)}), path)
    with pytest.raises(DvrError, match="its rows are not those"):
        read_shard(path)
    for changed in contradictions(table):
        pq.write_table(changed, path)
        with pytest.raises(DvrError, match=r"a\.parquet is no whole shard"):
            read_shard(path)
    pq.write_table(table.replace_schema_metadata({KEY: json.dumps(footer | {"schema": 1})}), path)
    with pytest.raises(DvrError, match=r"a\.parquet is no whole shard"):
        read_shard(path)
    optional = pa.schema(
        [field.with_nullable(True) for field in table.schema], metadata=table.schema.metadata
    )
    pq.write_table(table.cast(optional), path)
    with pytest.raises(DvrError, match="no shard of labels"):
        read_shard(path)


def contradictions(table: pa.Table) -> Iterator[pa.Table]:
    """The table with one number of a column changed, so that its columns contradict each other."""

    def changed(column: str, row: int, items: Callable[[list[float]], list[float]]) -> pa.Table:
        values = table[column].to_pylist()
        values[row] = items(values[row])
        place = table.schema.get_field_index(column)
        return table.set_column(
            place, table.schema.field(place), pa.array(values, table.schema.field(place).type)
        )

    for column in ("length", "shared", "verdict", "action", "violation", "numbers"):
        yield changed(column, 1, lambda items: items[:-1])
    yield changed("length", 0, lambda items: [*items[:-1], items[-1] + 1])
    yield changed("shared", 0, lambda items: [1, *items[1:]])
    yield changed("shared", 0, lambda items: [*items[:-1], 9])
    yield changed("action", 0, lambda items: [999, *items[1:]])
    yield changed("verdict", 0, lambda items: [0, 9999, *items[2:]])
    yield changed("verdict", 0, lambda items: [2, *items[1:]])


def test_list_is_sorted_and_ignores_other_files(folder: Path, tmp_path: Path) -> None:
    for info, name in zip(list_shards(folder), ("z", "b"), strict=True):
        (tmp_path / f"{name}.parquet").write_bytes(info.path.read_bytes())
    (tmp_path / "_manifest.json").write_text("{}")
    (tmp_path / ".b.parquet.1.tmp").write_text("half")
    assert [(info.path.name, info.scenes) for info in list_shards(tmp_path)] == [
        ("z.parquet", range(5)),
        ("b.parquet", range(5, 10)),
    ]


def test_overlapping_and_disagreeing_shards_are_refused(tmp_path: Path) -> None:
    write_shard(tmp_path / "a.parquet", *synthetic(0, 3, rows=5), OPTIONS)
    write_shard(tmp_path / "b.parquet", *synthetic(2, 4, rows=5), OPTIONS)
    with pytest.raises(
        DvrError, match=r"b\.parquet \(scenes 2 to 3\) and .*a\.parquet \(scenes 0 to 2\) overlap"
    ):
        list_shards(tmp_path)
    write_shard(tmp_path / "b.parquet", *synthetic(3, 4, rows=5), OPTIONS | {"k_max": 5})
    with pytest.raises(DvrError, match=r"different sweeps: k_max is 5 and 6"):
        list_shards(tmp_path)
    with pytest.raises(DvrError, match="there is no folder"):
        list_shards(tmp_path / "missing")


@pytest.mark.parametrize(
    ("name", "indices", "options", "message"),
    [
        ("a.txt", [0], OPTIONS, "suffix '.txt'; valid is '.parquet'"),
        ("a.parquet", [], OPTIONS, "consecutive indices"),
        ("a.parquet", [0, 2], OPTIONS, "consecutive indices"),
        ("a.parquet", [0], {}, "option 'seed' is None; valid is a whole number"),
        ("a.parquet", [0], {"seed": 1, "solver_seed": 0.5}, "option 'solver_seed' is 0.5"),
        ("a.parquet", [0], {"seed": 1, "time": float("nan")}, "cannot be written as JSON"),
        ("a.parquet", [0], {"seed": 1, "out": Path()}, "cannot be written as JSON"),
    ],
)
def test_bad_requests(
    name: str, indices: list[int], options: dict[str, object], message: str, tmp_path: Path
) -> None:
    scenes = synthetic(0, 3, rows=1)[0]
    with pytest.raises(DvrError, match=message):
        write_shard(tmp_path / name, {index: scenes[index] for index in indices}, [], options)
    assert list(tmp_path.iterdir()) == []
