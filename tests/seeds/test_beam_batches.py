"""Beams of many prefixes at once: what a prefix gets does not depend on what else is in the batch."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from nlp_cases import SCENE, SKELETONS
from solver_cases import JOINTS, MODEL

from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.operators import GRASP
from dvr_jax.runtime import batch_sizes
from dvr_jax.runtime.batch_sizes import CPU
from dvr_jax.seeds.beam_batches import BeamTask, extend_beams, lane_counts
from dvr_jax.seeds.keyframe_beam import BEAM_WIDTH, empty_beam

ROOT = empty_beam(3, 4, JOINTS)


def grasps(repeats: int = 1) -> Sequence[BeamTask]:
    """The first grasp of each skeleton."""
    proposal = GRASP.proposal(ModeKind.FIXED)
    return [
        BeamTask(ROOT, transcribe(SCENE, skeleton[:1]), proposal) for skeleton in SKELETONS
    ] * repeats


@pytest.mark.parametrize("lanes", [1, CPU.beam_lanes])
def test_beams_do_not_depend_on_the_batch(lanes: int) -> None:
    together = extend_beams(MODEL, grasps(3), [lanes] * 9, 5)
    for index in (0, 8):
        (alone,) = extend_beams(MODEL, [grasps()[index % 3]], [lanes], 5)
        for ours, theirs in zip(together[index], alone, strict=True):
            np.testing.assert_array_equal(ours, theirs)
    assert together[0].violation.shape == (BEAM_WIDTH,)
    (other,) = extend_beams(MODEL, [grasps()[0]], [lanes], 6)
    assert (other.q != together[0].q).any()


def test_few_prefixes_are_extended_alone_and_many_side_by_side() -> None:
    few = grasps()
    many = grasps(2)
    assert len(few) == CPU.few
    assert lane_counts(few) == [1] * CPU.few
    assert lane_counts(many) == [CPU.beam_lanes] * len(many)


def test_larger_batches_change_nothing_but_the_last_digits(monkeypatch: pytest.MonkeyPatch) -> None:
    """More prefixes side by side, as an accelerator has them."""
    tasks = grasps(3)
    few = extend_beams(MODEL, tasks, lane_counts(tasks), 5)
    monkeypatch.setattr(batch_sizes, "CPU", replace(CPU, beam_lanes=16, few=0))
    assert lane_counts(tasks) == [16] * len(tasks)
    for ours, theirs in zip(extend_beams(MODEL, tasks, [16] * 9, 5), few, strict=True):
        np.testing.assert_allclose(ours.violation, theirs.violation, atol=1e-5)
        np.testing.assert_allclose(ours.q, theirs.q, atol=1e-4)
