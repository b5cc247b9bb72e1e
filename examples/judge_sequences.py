"""Ask which of many action sequences are feasible, without a search."""

from collections import Counter

import dvr_jax as dvr

FACES = ("+x", "+y", "-x", "-y")

[scene] = dvr.sample_scenes(1, objects=2, seed=7)
name = scene.goal.object

# Every handover from left to right: which face does the left arm hold, and which does the right arm take?
handovers = [
    [f"grasp(left, {give}, {name})", f"grasp(right, {take}, {name})", f"place(right, {name}, goal)"]
    for give in FACES
    for take in FACES
]

# All sequences are judged together: they share prefixes and batches.
verdicts = dvr.feasibility(scene, handovers)

for verdict in verdicts:
    print(verdict)

# What refuted the others? "pose" and "sequence" are bounds on keyframes, "path" is the whole motion.
refuted = Counter(verdict.bound for verdict in verdicts if not verdict.feasible)
print(f"{sum(verdict.feasible for verdict in verdicts)} feasible; refuted by: {dict(refuted)}")

# A feasible verdict carries its motion, which the independent check has already accepted once.
for verdict in verdicts:
    if verdict.feasible:
        report = dvr.check(scene, verdict.actions, verdict.motion)
        print(
            f"checked again: {report.passed}, deepest contact {1000 * report.deepest_penetration:.2f} mm"
        )
        break
