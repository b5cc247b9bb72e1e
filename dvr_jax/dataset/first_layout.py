"""The layout of shards before version 0.9 (schema version 1), which is read but no longer written.

One row a scene:

    scene   int64
    json    string                    the scene as in a scene file
    labels  list<struct<
        actions         list<string>
        feasible        bool
        refuted_prefix  bool
        bound           string
        violation       float>>

`python -m dvr_jax.dataset repack` rewrites such shards in the layout of `dvr_jax.dataset.layout`.
"""

import numpy as np
import pyarrow as pa
from jaxtyping import Int64

from dvr_jax.dataset.columns import Columns

LABEL = pa.struct(
    [
        ("actions", pa.list_(pa.string())),
        ("feasible", pa.bool_()),
        ("refuted_prefix", pa.bool_()),
        ("bound", pa.string()),
        ("violation", pa.float32()),
    ]
)
"""The type of one label."""

SCHEMA = pa.schema([("scene", pa.int64()), ("json", pa.string()), ("labels", pa.list_(LABEL))])
"""The columns of a shard."""


def from_table(table: pa.Table) -> Columns:
    """Read the labels of a shard.

    Args:
        table: a table with the columns of SCHEMA.

    Returns:
        The labels in the order of the table, which is sorted.

    Raises:
        ValueError: a value is missing.
    """
    per_scene = table["labels"].combine_chunks()
    per_label = per_scene.flatten()
    actions = per_label.field("actions")
    words = actions.flatten().dictionary_encode()

    # This layout allows missing values, but the writer left none.
    parts = [table["json"], per_scene, per_label, actions, words, *per_label.flatten()]
    if any(part.null_count for part in parts):
        raise ValueError("a value is missing")

    return Columns(
        scene_texts=table["json"].to_pylist(),
        label_ends=_ends(per_scene),
        action_ends=_ends(actions),
        names=words.dictionary.to_pylist(),
        action=words.indices.to_numpy(zero_copy_only=False).astype(np.int64),
        feasible=per_label.field("feasible").to_numpy(zero_copy_only=False),
        refuted_prefix=per_label.field("refuted_prefix").to_numpy(zero_copy_only=False),
        bound=per_label.field("bound").to_pylist(),
        violation=per_label.field("violation").to_numpy(zero_copy_only=False),
    )


def _ends(lists: pa.Array) -> Int64[np.ndarray, " lists_plus_one"]:
    """Return where each list begins in the values of all lists, and their number."""
    ends = lists.offsets.to_numpy().astype(np.int64)
    return ends - ends[0]
