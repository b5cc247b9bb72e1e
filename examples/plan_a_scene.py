"""Plan a random scene, print the plan, and save its trajectory and pictures."""

import sys
from pathlib import Path

import dvr_jax as dvr

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/plan_a_scene")

# The scenes of one seed are always the same.
[scene] = dvr.sample_scenes(1, objects=2, seed=7)

# The first plan on a machine compiles for about a minute, which counts towards the time limit.
result = dvr.plan(scene, time_limit=600)

print(f"status: {result.status}")
for number, description in enumerate(result.action_descriptions, start=1):
    print(f"  {number}. {description}")

# "Solved" means that the independent check accepted the motion.
if not result.solved:
    sys.exit("no plan was found")

print(
    f"motion: {result.motion.time[-1]:.1f} s, deepest contact {1000 * result.report.deepest_penetration:.2f} mm"
)
print(f"planned in {result.seconds['total']:.2f} s")

# plan.json, trajectory.npz, scene.xml, film.png, depth.png and plan.gif.
result.save(folder)
print(f"written to {folder}")
