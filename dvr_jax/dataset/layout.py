"""The layout of a shard's columns (schema version 2): about 400 bytes a scene with 450 labels.

One row a scene, so that a scene is stored once and a scene without labels has its place too:

    scene           int64           index of the scene
    template        string          the scene as in a scene file, with `#` for each decimal number
    numbers         list<double>    the numbers of the scene
    names           list<string>    the distinct actions of the scene's labels, sorted
    length          list<uint16>    number of actions of each label
    shared          list<uint16>    number of its last actions that the label before it has too
    action          list<uint16>    its other actions, the last one first, as indices into `names`
    verdict         list<uint32>    0: the next entry of the three lists below; v: their entry v - 1 once more
    refuted_prefix  list<bool>      the distinct verdicts of the scene, in the order in which labels first have them
    bound           list<string>    "" if feasible
    violation       list<float>     rounded to VIOLATION_BITS binary digits, about three decimal ones

`compact_actions`, `compact_verdicts` and `scene_text` say how the columns come about.
"""

from typing import Any

import numpy as np
import pyarrow as pa
from jaxtyping import Int64

from dvr_jax.dataset.columns import Columns
from dvr_jax.dataset.compact_actions import CompactActions, compact_actions, expand_actions
from dvr_jax.dataset.compact_verdicts import (
    CompactVerdicts,
    Verdicts,
    compact_verdicts,
    expand_verdicts,
)
from dvr_jax.dataset.scene_text import SceneText


def _list_of(item: pa.DataType) -> pa.DataType:
    """Return the type of lists without missing items: what cannot be missing takes no room."""
    return pa.list_(pa.field("element", item, nullable=False))


_COLUMNS: dict[str, pa.DataType] = {
    "scene": pa.int64(),
    "template": pa.string(),
    "numbers": _list_of(pa.float64()),
    "names": _list_of(pa.string()),
    "length": _list_of(pa.uint16()),
    "shared": _list_of(pa.uint16()),
    "action": _list_of(pa.uint16()),
    "verdict": _list_of(pa.uint32()),
    "refuted_prefix": _list_of(pa.bool_()),
    "bound": _list_of(pa.string()),
    "violation": _list_of(pa.float32()),
}

SCHEMA = pa.schema([pa.field(name, kind, nullable=False) for name, kind in _COLUMNS.items()])
"""The columns of a shard."""

PARQUET_OPTIONS: dict[str, Any] = {
    "compression": "zstd",
    "compression_level": 22,
    "use_dictionary": ["template", "names.list.element", "bound.list.element"],
    # The high bytes of small numbers are all zero: in streams of their own they take no room.
    "column_encoding": {
        "scene": "DELTA_BINARY_PACKED",
        "length.list.element": "BYTE_STREAM_SPLIT",
        "shared.list.element": "BYTE_STREAM_SPLIT",
        "action.list.element": "BYTE_STREAM_SPLIT",
        "verdict.list.element": "BYTE_STREAM_SPLIT",
        "violation.list.element": "BYTE_STREAM_SPLIT",
    },
    "write_statistics": False,
    "write_page_checksum": True,
    # Arrow's own copy of the schema would take six bytes a scene, and says nothing that Parquet's does not.
    "store_schema": False,
}
"""Options of `pyarrow.parquet.ParquetWriter`: they gave the smallest files of those tried."""


def to_table(columns: Columns, first_scene: int) -> pa.Table:
    """Lay out the labels of a shard.

    Args:
        columns: the labels.
        first_scene: index of the first scene.

    Returns:
        A table with the columns of SCHEMA.
    """
    label_ends = columns.label_ends
    actions, order = compact_actions(columns)
    verdicts_by_name = Verdicts(columns.refuted_prefix, columns.bound, columns.violation)
    verdicts = compact_verdicts(verdicts_by_name.take(order), label_ends)
    texts = [SceneText.take_apart(text) for text in columns.scene_texts]

    return pa.table(
        {
            "scene": np.arange(len(texts)) + first_scene,
            "template": [text.template for text in texts],
            "numbers": [text.numbers for text in texts],
            "names": actions.names,
            "length": _lists("length", label_ends, actions.length),
            "shared": _lists("shared", label_ends, actions.shared),
            "action": _lists("action", actions.action_ends, actions.action),
            "verdict": _lists("verdict", label_ends, verdicts.number),
            "refuted_prefix": _lists(
                "refuted_prefix", verdicts.ends, verdicts.distinct.refuted_prefix
            ),
            "bound": _lists("bound", verdicts.ends, verdicts.distinct.bound),
            "violation": _lists("violation", verdicts.ends, verdicts.distinct.violation),
        },
        schema=SCHEMA,
    )


def from_table(table: pa.Table) -> Columns:
    """Read the labels of a shard.

    Args:
        table: a table with the columns of SCHEMA.

    Returns:
        The labels, sorted.

    Raises:
        ValueError: the columns contradict each other.
    """
    label_ends, length = _values(table, "length")
    shared_ends, shared = _values(table, "shared")
    number_ends, number = _values(table, "verdict")
    action_ends, action = _values(table, "action")
    compact = CompactActions(table["names"].to_pylist(), length, shared, action, label_ends)
    if not (np.array_equal(label_ends, shared_ends) and np.array_equal(label_ends, number_ends)):
        raise ValueError("the columns have different numbers of labels")

    # The columns are in the order of the last actions; labels are handed out in the order of names.
    actions = expand_actions(compact)
    if not np.array_equal(compact.action_ends, action_ends):
        raise ValueError("the number of actions is not that of the labels")
    distinct, verdict_ends = _distinct_verdicts(table)
    compact_form = CompactVerdicts(number, distinct, verdict_ends)
    verdicts = expand_verdicts(compact_form, label_ends).take(actions.order)

    return Columns(
        scene_texts=_scene_texts(table),
        label_ends=label_ends,
        action_ends=actions.action_ends,
        names=actions.names,
        action=actions.action,
        feasible=np.array([bound == "" for bound in verdicts.bound], dtype=np.bool_),
        refuted_prefix=verdicts.refuted_prefix,
        bound=verdicts.bound,
        violation=verdicts.violation,
    )


def _distinct_verdicts(table: pa.Table) -> tuple[Verdicts, Int64[np.ndarray, " scenes_plus_one"]]:
    """Read the distinct verdicts of all scenes, and where those of each scene begin."""
    prefix_ends, refuted_prefix = _values(table, "refuted_prefix")
    bound_ends, bound = _values(table, "bound")
    violation_ends, violation = _values(table, "violation")
    if not (
        np.array_equal(prefix_ends, bound_ends) and np.array_equal(prefix_ends, violation_ends)
    ):
        raise ValueError("the columns have different numbers of verdicts")

    verdicts = Verdicts(
        refuted_prefix.astype(np.bool_), bound.tolist(), violation.astype(np.float32)
    )
    return verdicts, prefix_ends


def _scene_texts(table: pa.Table) -> list[str]:
    templates = table["template"].to_pylist()
    numbers = table["numbers"].to_pylist()
    return [
        SceneText(template, tuple(own)).put_together()
        for template, own in zip(templates, numbers, strict=True)
    ]


def _lists(
    column: str,
    ends: Int64[np.ndarray, " scenes_plus_one"],
    values: "np.ndarray | list[str]",
) -> pa.Array:
    """Make a column of lists from their values end to end."""
    kind = _COLUMNS[column]
    flat = pa.array(values, type=kind.value_type)
    return pa.ListArray.from_arrays(pa.array(ends, type=pa.int32()), flat, type=kind)


def _values(
    table: pa.Table, column: str
) -> tuple[Int64[np.ndarray, " scenes_plus_one"], np.ndarray]:
    """Return where each list of a column begins, and the values of all lists end to end."""
    lists = table[column].combine_chunks()
    ends = lists.offsets.to_numpy().astype(np.int64)
    values = lists.flatten().to_numpy(zero_copy_only=False)
    if np.issubdtype(values.dtype, np.integer):
        values = values.astype(np.int64)
    return ends - ends[0], values
