"""Work that searches ask for: a search gets the same, whoever else is served with it."""

from collections.abc import Sequence

import jax
import numpy as np
from nlp_cases import SCENE, SKELETONS
from solver_cases import JOINTS, MODEL

from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.operators import GRASP
from dvr_jax.search.work import ExtendBeams, Steps, run_alone, run_together
from dvr_jax.seeds.beam_batches import BeamTask
from dvr_jax.seeds.keyframe_beam import KeyframeBeam, empty_beam


def test_a_beam_does_not_depend_on_what_else_is_asked_for() -> None:
    """The first grasps of one search alone, and beside those of another."""
    root = empty_beam(3, 4, JOINTS)
    proposal = GRASP.proposal(ModeKind.FIXED)
    few = [BeamTask(root, transcribe(SCENE, skeleton[:1]), proposal) for skeleton in SKELETONS]

    def ask(tasks: Sequence[BeamTask]) -> Steps[list[KeyframeBeam]]:
        return (yield ExtendBeams(MODEL, tasks, 5))

    alone = [run_alone(ask(tasks)) for tasks in (few, few * 2)]
    for index, beside in run_together([ask(few), ask(few * 2)]):
        for ours, theirs in zip(
            jax.tree.leaves(beside), jax.tree.leaves(alone[index]), strict=True
        ):
            np.testing.assert_array_equal(ours, theirs)
    for ours, theirs in zip(
        jax.tree.leaves(alone[0]), jax.tree.leaves(alone[1][: len(few)]), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs)
