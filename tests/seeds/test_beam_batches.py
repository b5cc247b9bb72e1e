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
from dvr_jax.seeds import keyframe_beam
from dvr_jax.seeds.beam_batches import BeamTask, extend_beams, prepare_penetration
from dvr_jax.seeds.keyframe_beam import BEAM_WIDTH, empty_beam

ROOT = empty_beam(3, 4, JOINTS)


def grasps(repeats: int = 1) -> Sequence[BeamTask]:
    """The first grasp of each skeleton."""
    proposal = GRASP.proposal(ModeKind.FIXED)
    return [
        BeamTask(ROOT, transcribe(SCENE, skeleton[:1]), proposal) for skeleton in SKELETONS
    ] * repeats


def test_beams_do_not_depend_on_the_batch() -> None:
    together = extend_beams(MODEL, grasps(3), 5)
    for index in (0, 8):
        (alone,) = extend_beams(MODEL, [grasps()[index % 3]], 5)
        for ours, theirs in zip(together[index], alone, strict=True):
            np.testing.assert_array_equal(ours, theirs)
    assert together[0].violation.shape == (BEAM_WIDTH,)
    (other,) = extend_beams(MODEL, [grasps()[0]], 6)
    assert (other.q != together[0].q).any()


def test_the_program_that_is_compiled_ahead_is_the_one_that_an_extension_calls() -> None:
    task = grasps()[0]
    prepare_penetration(MODEL, task)
    program = keyframe_beam.PENETRATION
    ready = set(program._compiled)
    extend_beams(MODEL, [task], 5)
    assert set(program._compiled) == ready


def test_larger_batches_change_nothing_but_the_last_digits(monkeypatch: pytest.MonkeyPatch) -> None:
    """More prefixes side by side, as an accelerator has them."""
    tasks = grasps(3)
    few = extend_beams(MODEL, tasks, 5)
    monkeypatch.setattr(batch_sizes, "CPU", replace(CPU, beam_lanes=16))
    for ours, theirs in zip(extend_beams(MODEL, tasks, 5), few, strict=True):
        np.testing.assert_allclose(ours.violation, theirs.violation, atol=1e-5)
        np.testing.assert_allclose(ours.q, theirs.q, atol=1e-4)
