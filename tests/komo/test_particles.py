"""What a particle proves holds in the NLP: keyframes whose violation is that of a witness are within all tolerances."""

import numpy as np
import pytest
from komo_cases import violations_of

from dvr_jax.bench.recall import PROBLEMS, read_problems
from dvr_jax.nlp.problem import Variables
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.search.node_solver import CERTIFIED_PENETRATION
from dvr_jax.seeds.keyframe_beam import case_of, empty_prefix
from dvr_jax.solver.lane_pool import extend_beams, stack


@pytest.mark.parametrize("length", [2, 4])
def test_witnesses_are_feasible_keyframes(length: int) -> None:
    """Of prefixes that random starts have found feasible: grasps, handovers and places of two boxes."""
    cases: set[str] = set()
    proved = 0
    for scene, actions, row in read_problems(PROBLEMS):
        if row["kind"] != "keyframes" or row["length"] != length or not row["feasible"]:
            continue
        particles = empty_prefix(len(scene.objects), length)
        for number in range(1, length + 1):
            problem = transcribe(scene, actions[:number])
            particles = extend_beams([particles], [problem], 3, [1])[0]
            item = problem.switched_object[number - 1]
            cases.add(case_of(int(problem.attachment[number - 1, item]), actions[number - 1].operator == "grasp"))
        x = Variables(particles.q.astype(float), particles.m.astype(float))
        violations = violations_of(stack([problem] * len(x.q)), x)
        witness = particles.violation <= CERTIFIED_PENETRATION
        assert (np.asarray(violations.ratio())[witness] <= 1).all(), actions
        proved += int(witness.sum())
    assert proved > 50 and cases == {"grasp", "handover", "place"}
