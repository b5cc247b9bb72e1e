"""Build a scene in Python, save it as a file, load it again, and plan it."""

import sys
from pathlib import Path

import dvr_jax as dvr

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/your_own_scene")
folder.mkdir(parents=True, exist_ok=True)

# Meters and radians. A box has its full extents as size, a cylinder its radius and height.
box = dvr.SceneObject("box", "box", size=(0.05, 0.16, 0.10), position=(-0.40, -0.25), yaw=0.4)
can = dvr.SceneObject("can", "cylinder", size=(0.03, 0.12), position=(-0.30, 0.30), yaw=0.0)

# The can has to stand on this square with its whole footprint.
target = dvr.Region(position=(-0.40, 0.05), yaw=0.0, size=(0.12, 0.12))
scene = dvr.Scene(objects=(box, can), goal=dvr.OnRegion("can", target))

# The file is plain JSON. Loading it checks every rule that a scene has to keep.
dvr.save_scene(folder / "scene.json", scene)
assert dvr.load_scene(folder / "scene.json") == scene

# A broken scene is refused in one sentence that names the culprit.
text = (folder / "scene.json").read_text().replace('"can"', '"jar"', 1)
(folder / "broken.json").write_text(text)
try:
    dvr.load_scene(folder / "broken.json")
except dvr.DvrError as error:
    print(f"refused: {error}")

result = dvr.plan(scene, time_limit=600)
print(result.status, *result.action_descriptions, sep="\n  ")

# Where everything stands afterwards: the beginning of a next plan.
if result.solved:
    for item in result.scene_after().objects:
        print(f"{item.name} ends at x = {item.position[0]:.3f} m, y = {item.position[1]:.3f} m")
