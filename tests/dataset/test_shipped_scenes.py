"""The scenes of the shipped labels, and the scenes that are drawn today."""

from pathlib import Path

from dvr_jax.dataset.shards import read_shard
from dvr_jax.scene.files import are_equal_but_for_rounding
from dvr_jax.scene.sampling import sample_scenes


def test_the_scenes_of_the_shipped_labels_are_drawn_again() -> None:
    shipped = read_shard(Path("data/labels/train/labels-000000.parquet")).scenes
    drawn = sample_scenes(len(shipped), 2, 100)
    assert len(shipped) > 100 and all(map(are_equal_but_for_rounding, drawn, shipped))
