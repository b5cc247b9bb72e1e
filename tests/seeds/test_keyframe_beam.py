"""What a candidate proves holds in the NLP: keyframes that hardly penetrate are within all tolerances."""

import jax
import numpy as np
import pytest
from nlp_cases import violations_of

from dvr_jax.bench.problems import read_problems
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.evaluation import relative_violation
from dvr_jax.nlp.problem import Variables
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.operators import OPERATORS, operator_of
from dvr_jax.seeds.beam_batches import BeamTask, extend_beams
from dvr_jax.seeds.keyframe_beam import BEAM_WIDTH, CERTIFIED_PENETRATION, empty_beam
from dvr_jax.workcell.model import workcell_model


@pytest.mark.parametrize("length", [2, 4])
def test_candidates_that_do_not_penetrate_are_feasible_keyframes(length: int) -> None:
    """Of prefixes that random starts have found feasible: grasps, handovers and places of two boxes."""
    proposals: set[str] = set()
    proved = 0
    for scene, actions, row in read_problems():
        if row["kind"] != "keyframes" or row["length"] != length or not row["feasible"]:
            continue
        model = workcell_model(scene.workcell)
        beam = empty_beam(len(scene.objects), length, scene.workcell.number_of_joints)
        for number in range(1, length + 1):
            problem = transcribe(scene, actions[:number])
            before = ModeKind(
                int(problem.mode_kind[number - 1, problem.switched_object[number - 1]])
            )
            proposal = operator_of(actions[number - 1], OPERATORS).proposal(before)
            (beam,) = extend_beams(model, [BeamTask(beam, problem, proposal)], 3)
            proposals.add(proposal.name)
        x = Variables(beam.q.astype(float), beam.m.astype(float))
        problems = jax.tree.map(lambda leaf: np.stack([leaf] * BEAM_WIDTH), problem)
        violations = violations_of(model, problems, x)
        is_proof = beam.violation <= CERTIFIED_PENETRATION
        assert (np.asarray(relative_violation(violations))[is_proof] <= 1).all(), actions
        proved += int(is_proof.sum())
    assert proved > 50 and proposals == {"grasp", "handover", "place"}
