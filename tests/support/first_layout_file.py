"""A writer of shards in their first layout, as it was up to version 0.8."""

import json
from pathlib import Path

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq

from dvr_jax.dataset.first_layout import SCHEMA
from dvr_jax.dataset.footer import FIRST_SCHEMA
from dvr_jax.dataset.shards import KEY, Shard
from dvr_jax.scene.files import scene_to_json


def write_first_layout(path: Path, shard: Shard) -> None:
    footer = msgspec.to_builtins(shard.info.footer) | {"schema": FIRST_SCHEMA, "checksum": ""}
    rows = [
        {
            "scene": index,
            "json": scene_to_json(scene),
            "labels": [
                {
                    "actions": label.actions,
                    "feasible": label.feasible,
                    "refuted_prefix": label.refuted_prefix,
                    "bound": label.bound,
                    "violation": label.violation,
                }
                for label in shard.labels
                if label.scene == index
            ],
        }
        for index, scene in zip(shard.info.scenes, shard.scenes, strict=True)
    ]
    schema = SCHEMA.with_metadata({KEY: json.dumps(footer).encode()})
    pq.write_table(
        pa.Table.from_pylist(rows, schema=schema),
        path,
        compression="zstd",
        write_page_checksum=True,
    )
