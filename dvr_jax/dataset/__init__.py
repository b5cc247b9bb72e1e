"""The data set: verdicts on action sequences of many scenes, their files, and the training examples made of them."""

from dvr_jax.dataset.counts import count_labels
from dvr_jax.dataset.examples import Examples, count_targets, load_examples
from dvr_jax.dataset.folder_manifest import write_manifest
from dvr_jax.dataset.footer import ShardInfo
from dvr_jax.dataset.labels import BOUNDS, Label
from dvr_jax.dataset.shards import Shard, find_shards, list_shards, read_shard, same_rows, write_shard
from dvr_jax.dataset.targets import targets

__all__ = [
    "BOUNDS",
    "Examples",
    "Label",
    "Shard",
    "ShardInfo",
    "count_labels",
    "count_targets",
    "find_shards",
    "list_shards",
    "load_examples",
    "read_shard",
    "same_rows",
    "targets",
    "write_manifest",
    "write_shard",
]
