"""Make the figures of the concept pages, and the animation of the README.

    python docs/make_figures.py            # all of them
    python docs/make_figures.py path check # some of them

The pictures are written into `docs/figures/`, the animation into `data/pictures/plan.gif`. Look at them afterwards.
"""

from __future__ import annotations

import json
import shutil
import statistics
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import matplotlib

matplotlib.use("agg")

import matplotlib.pyplot as plt
import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Polygon

import dvr_jax as dvr
from dvr_jax.bench.public_problems import FAMILIES, read_public_scenes
from dvr_jax.checker.tolerances import DEEPEST_CONTACT, DEEPEST_GRIP
from dvr_jax.drawing.animation import save_animation
from dvr_jax.drawing.picture import render_states
from dvr_jax.model.images import depth_images
from dvr_jax.scene.camera import render_depth
from dvr_jax.scene.layout import home_qpos
from dvr_jax.scene.mjcf import build_model

REPOSITORY = Path(__file__).resolve().parents[1]
FIGURES = REPOSITORY / "docs" / "figures"
SCENE = REPOSITORY / "data" / "scenes" / "figure1.json"
ROWS = REPOSITORY / "bench" / "results" / "search"

INK, SOFT, GOAL, LINE = "#1c1e22", "#6a6e76", "#d9261a", "#3f6fb5"
COLORS = {"yellow": "#f2b90f", "blue": "#2160c4", "green": "#2f9e4a"}
"""Of the objects of the scene, near to those of the pictures."""

PANDA_REACH = 0.855
"""Published reach of a Panda from its base's axis [m]."""

BASES = {"left": (-0.75, 0.0), "right": (0.75, 0.0)}
"""Bases of the default workcell [m]."""

plt.rcParams.update(
    {"font.size": 10, "axes.edgecolor": SOFT, "text.color": INK, "axes.labelcolor": INK}
)


@cache
def solve() -> dvr.Plan:
    """Return the plan of the example scene, which is made once."""
    result = dvr.plan(dvr.load_scene(SCENE), time_limit=1200)
    assert result.solved, result.status
    return result


def save(figure: Figure, name: str) -> None:
    """Write a figure as a small PNG."""
    FIGURES.mkdir(parents=True, exist_ok=True)
    figure.savefig(
        FIGURES / f"{name}.png", dpi=110, facecolor="white", bbox_inches="tight", pad_inches=0.1
    )
    plt.close(figure)


def rectangle(position: tuple[float, float], size: tuple[float, ...], yaw: float) -> np.ndarray:
    """Return the corners (4, 2) of a rectangle with this center, these full extents and this turn [m, rad]."""
    x, y = size[0] / 2, size[1] / 2
    corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return corners @ np.array([[cosine, sine], [-sine, cosine]]) + position


def draw_base(axes: Axes, name: str) -> None:
    """Draw the foot of an arm's base and the arm's reach."""
    x, y = BASES[name]
    behind = -np.sign(-x)

    # The foot: a disc around the axis and a plate that reaches 12.5 cm behind it.
    plate = rectangle((x + behind * 0.0625, y), (0.125, 0.11), 0.0)
    axes.add_patch(Polygon(plate, facecolor="white", edgecolor=INK, hatch="////", linewidth=0.8))
    axes.add_patch(
        Circle((x, y), 0.085, facecolor="white", edgecolor=INK, hatch="////", linewidth=0.8)
    )
    axes.add_patch(
        Circle((x, y), PANDA_REACH, fill=False, edgecolor=LINE, linestyle="--", linewidth=1)
    )
    axes.text(x, y - 0.12, f"{name} arm", ha="center", va="top", fontsize=9)
    axes.text(
        x,
        y + PANDA_REACH - 0.03,
        f"reach {PANDA_REACH} m",
        ha="center",
        va="top",
        fontsize=9,
        color=LINE,
    )


def make_scene() -> None:
    """Draw the example scene from above."""
    scene = dvr.load_scene(SCENE)
    figure, axes = plt.subplots(figsize=(7, 6.2))

    # Table, arms, target and objects, from bottom to top.
    table = axes.add_patch(
        Polygon(rectangle((0, 0), (2.2, 2.0), 0.0), facecolor="#eeeae3", edgecolor=SOFT)
    )
    for name in BASES:
        draw_base(axes, name)
    region = scene.paper_goal.region
    axes.add_patch(
        Polygon(rectangle(region.position, region.size, region.yaw), facecolor=GOAL, alpha=0.75)
    )
    for item in scene.objects:
        corners = rectangle(item.position, item.size, item.yaw)
        axes.add_patch(Polygon(corners, facecolor=COLORS[item.name], edgecolor=INK, linewidth=0.8))
        axes.annotate(item.name, item.position, (0, 16), textcoords="offset points", ha="center")
    axes.annotate(
        "goal region",
        region.position,
        (0, -30),
        textcoords="offset points",
        ha="center",
        color=GOAL,
    )

    # The world frame.
    for direction, label in (((0.16, 0.0), "x"), ((0.0, 0.16), "y")):
        axes.annotate("", direction, (0, 0), arrowprops={"arrowstyle": "->", "color": INK})
        axes.text(1.2 * direction[0], 1.2 * direction[1], label, ha="center", va="center")

    for patch in axes.patches:
        patch.set_clip_path(table)
    axes.set(xlim=(-1.15, 1.15), ylim=(-1.05, 1.05), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    save(figure, "scene")


NODES = {
    "scene": (0.0, 2.0, "start"),
    "a": (1.15, 3.3, "grasp(left, +x, yellow)"),
    "b": (1.15, 2.0, "grasp(left, +y, yellow)"),
    "c": (1.15, 0.7, "grasp(right, +x, blue)"),
    "aa": (2.65, 3.75, "place(left, yellow, goal)"),
    "ab": (2.65, 2.95, "grasp(right, -x, yellow)"),
    "ba": (2.65, 2.0, "place(left, yellow, table)"),
    "ca": (2.65, 1.1, "place(right, blue, table)"),
    "cb": (2.65, 0.3, "grasp(left, +y, blue)"),
    "aba": (4.15, 2.95, "place(right, yellow, goal)"),
    "caa": (4.15, 1.1, "grasp(right, +x, yellow)"),
}
"""Nodes of the drawn tree: column, row, action. A node's parent is named by all letters but its last one."""

LEAVES = ("aa", "aba")
"""Nodes at which the goal holds."""


def make_skeleton() -> None:
    """Draw a part of the tree of action sequences."""
    figure, axes = plt.subplots(figsize=(11, 3.9))

    for name, (x, y, _) in NODES.items():
        if name != "scene":
            parent = NODES[name[:-1] or "scene"]
            axes.plot(
                [parent[0] + (0.62 if len(name) > 1 else 0.3), x - 0.62],
                [parent[1], y],
                color=SOFT,
                linewidth=1,
            )

    for name, (x, y, text) in NODES.items():
        width = 0.6 if name == "scene" else 1.24
        box = FancyBboxPatch(
            (x - width / 2, y - 0.2), width, 0.4, boxstyle="round,pad=0,rounding_size=0.08"
        )
        box.set(
            facecolor="#fbe3e1" if name in LEAVES else "#f0f1f3",
            edgecolor=GOAL if name in LEAVES else SOFT,
        )
        axes.add_patch(box)
        axes.text(x, y, text, ha="center", va="center", fontsize=8.5)

    # What is left out.
    for x, y in ((1.15, -0.05), (2.65, -0.25), (4.15, 0.3), (4.15, 2.0), (5.0, 1.1)):
        axes.text(x, y, "...", ha="center", va="center", fontsize=14, color=SOFT)
    for column, x in enumerate((1.15, 2.65, 4.15), start=1):
        axes.text(x, 4.3, f"action {column}", ha="center", color=SOFT)
    axes.set(xlim=(-0.4, 5.2), ylim=(-0.5, 4.5))
    axes.axis("off")
    save(figure, "skeleton")


def make_keyframes() -> None:
    """Draw the film of the plan: its initial state and its keyframes."""
    FIGURES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        solve().save(folder, animation=False)
        shutil.copyfile(f"{folder}/film.png", FIGURES / "keyframes.png")


def make_path() -> None:
    """Draw joint angles along the plan, and the sparsity of the Gauss-Newton matrix."""
    motion = solve().motion
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(11, 3.9), width_ratios=(1.7, 1), layout="constrained"
    )

    # The second arm's joints follow the first one's seven joints and two fingers.
    for joint in range(7):
        left.plot(motion.time, motion.qpos[:, 9 + joint], label=f"joint {joint + 1}", linewidth=1.3)
    for number, sample in enumerate(motion.switch, start=1):
        left.axvline(motion.time[sample], color=SOFT, linewidth=0.8, linestyle=":")
        left.text(
            motion.time[sample],
            1.01,
            f"action {number}",
            transform=left.get_xaxis_transform(),
            ha="right",
            fontsize=8,
        )
    left.set(xlabel="time [s]", ylabel="angle of the right arm [rad]", xlim=(0, motion.time[-1]))
    left.legend(
        ncols=7,
        fontsize=8,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.14),
        frameon=False,
        columnspacing=1,
    )

    # A grasp, a handover and a place, with five slices each: one square is a block of one slice or one action.
    slices, actions = 15, 3
    blocks = np.zeros((slices + actions, slices + actions))
    for row in range(slices):
        blocks[row, max(0, row - 2) : min(slices, row + 3)] = 1
    for action in range(actions):
        # A mode parameter matters from its own switch to the next switch of the object.
        column, held = slices + action, slice(5 * action + 4, 5 * action + 10)
        blocks[:slices, column][held] = blocks[column, :slices][held] = 2
        blocks[column, max(slices, column - 1) : column + 2] = 2
    colors = matplotlib.colors.ListedColormap(["#ffffff", LINE, GOAL])
    right.imshow(blocks, cmap=colors, interpolation="nearest")
    right.set_xticks(np.arange(-0.5, slices + actions), minor=True)
    right.set_yticks(np.arange(-0.5, slices + actions), minor=True)
    right.grid(which="minor", color="white", linewidth=1.5)
    right.tick_params(which="both", length=0, labelbottom=False, labelleft=False)
    right.set_xlabel("slices (blue), mode parameters (red)")
    save(figure, "path")


def deepest_contacts(model: mujoco.MjModel, states: np.ndarray) -> np.ndarray:
    """Return the deepest penetration (T,) of each state (T, nq) [m]."""
    data = mujoco.MjData(model)
    depths = np.zeros(len(states))

    for index, qpos in enumerate(states):
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        depths[index] = max(0.0, -float(data.contact.dist.min(initial=0.0)))
    return depths


def held_intervals(result: dvr.Plan) -> list[tuple[str, str, float, float]]:
    """Return arm, object, beginning and end [s] of each interval in which an arm holds an object."""
    held: dict[str, tuple[str, float]] = {}
    intervals = []

    for action, sample in zip(result.actions, result.motion.switch, strict=True):
        now = float(result.motion.time[sample])
        arm, *middle = action.arguments
        name = middle[1] if action.operator == "grasp" else middle[0]
        if name in held:
            giver, since = held.pop(name)
            intervals.append((giver, name, since, now))
        if action.operator == "grasp":
            held[name] = (arm, now)

    end = float(result.motion.time[-1])
    return intervals + [(arm, name, since, end) for name, (arm, since) in held.items()]


def make_check() -> None:
    """Draw the deepest contact along the plan, and who holds what."""
    result = solve()
    with tempfile.TemporaryDirectory() as folder:
        result.save(folder, pictures=False, animation=False)
        model = mujoco.MjModel.from_xml_path(f"{folder}/scene.xml")
    depths = 1000 * deepest_contacts(model, result.motion.qpos)

    figure, (top, bottom) = plt.subplots(
        2, 1, figsize=(9, 4.2), height_ratios=(2, 1), sharex=True, layout="constrained"
    )
    top.fill_between(result.motion.time, depths, color=LINE, alpha=0.35, linewidth=0)
    top.plot(result.motion.time, depths, color=LINE, linewidth=1)
    for limit, pair in ((DEEPEST_GRIP, "a hand and its object"), (DEEPEST_CONTACT, "all others")):
        height = 1e3 * limit
        top.axhline(height, color=GOAL, linewidth=1.2)
        top.text(0.2, height + 0.03, f"limit for {pair}", color=GOAL, va="bottom", fontsize=9)
    top.set(ylabel="deepest contact [mm]", ylim=(0, 3.8))

    arms = ("right", "left")
    for arm, name, begin, end in held_intervals(result):
        row = arms.index(arm)
        bottom.barh(
            row,
            end - begin,
            left=begin,
            height=0.6,
            color=COLORS[name],
            edgecolor=INK,
            linewidth=0.6,
        )
        bottom.text((begin + end) / 2, row, name, ha="center", va="center", fontsize=9)
    bottom.set(
        yticks=range(len(arms)), yticklabels=[f"{arm} holds" for arm in arms], xlabel="time [s]"
    )
    bottom.set(xlim=(0, result.motion.time[-1]), ylim=(-0.5, 1.5))
    save(figure, "check")


def make_search() -> None:
    """Draw how many prefixes each bound judges, by search, on the scenes that are solved with four actions."""
    bounds = ("symbolic", "pose", "sequence", "path")
    names = {"dvr": "network", "classifier": "classifier", "mbts": "multi-bound tree search"}
    figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")

    for index, (search, label) in enumerate(names.items()):
        lines = (ROWS / f"{search}.jsonl").read_text(encoding="utf-8").splitlines()[1:]
        rows = [
            row
            for row in map(json.loads, lines)
            if row["status"] == "solved" and len(row["words"]) == 4
        ]
        means = [statistics.mean(row["verdicts"].get(bound, 0) for row in rows) for bound in bounds]
        places = np.arange(len(bounds)) + 0.27 * (index - 1)
        bars = axes.bar(places, means, width=0.25, label=f"{label} ({len(rows)} scenes)")
        axes.bar_label(
            bars,
            [f"{mean:.0f}" if mean >= 10 else f"{mean:.1f}" for mean in means],
            fontsize=8,
            padding=2,
        )

    axes.set(
        yscale="log", ylim=(0.5, 20000), xticks=range(len(bounds)), ylabel="prefixes judged (mean)"
    )
    axes.set_xticklabels([f"{bound} bound" for bound in bounds])
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    save(figure, "search")


def make_network() -> None:
    """Draw the three channels that the network sees of placing the goal's object on the goal."""
    scene = dvr.load_scene(SCENE)
    images = depth_images(scene, render_depth(scene, 256, 256), size=64)
    names = [item.name for item in scene.objects]
    figure, panels = plt.subplots(1, 3, figsize=(11, 3.7), layout="constrained")

    # A unit of height is 10 cm.
    shown = panels[0].imshow(10 * images.height, cmap="viridis", vmin=0, vmax=16)
    figure.colorbar(shown, ax=panels[0], label="height [cm]", shrink=0.85)
    panels[0].set_title("depth, relative to the empty table")
    masks = (
        ("mask of the object (yellow)", names.index("yellow")),
        ("mask of the goal region", len(names)),
    )
    for axes, (title, index) in zip(panels[1:], masks, strict=True):
        axes.imshow(images.masks[index], cmap="gray", vmin=0, vmax=255)
        axes.set_title(title)
    for axes in panels:
        axes.set(xticks=(), yticks=())
    save(figure, "network")


def make_plan() -> None:
    """Write the animation of the README: twice as fast as the motion."""
    result = solve()
    path = REPOSITORY / "data" / "pictures" / "plan.gif"
    save_animation(
        path, result.scene, result.motion, frames_per_second=5, speed=2, width=480, height=300
    )


def make_public() -> None:
    """Draw one scene of each family of public problems; of some, one with several objects."""
    columns = 3
    rows = -(-len(FAMILIES) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(12, 2.7 * rows), layout="constrained")
    for axis in axes.flat:
        axis.axis("off")
    for axis, family in zip(axes.flat, FAMILIES, strict=False):
        scenes = [scene for _, scene in read_public_scenes([family.name])]
        scene = max(scenes[:10], key=lambda scene: len(scene.objects))
        (picture,) = render_states(build_model(scene), home_qpos(scene)[None], 640, 400)
        axis.imshow(picture[20:340])
        axis.set_title(family.name)
    save(figure, "public")


MAKERS: dict[str, Callable[[], None]] = {
    "scene": make_scene,
    "skeleton": make_skeleton,
    "keyframes": make_keyframes,
    "path": make_path,
    "check": make_check,
    "search": make_search,
    "network": make_network,
    "plan": make_plan,
    "public": make_public,
}


def main() -> None:
    """Make the figures that are named, or all of them."""
    for name in sys.argv[1:] or MAKERS:
        MAKERS[name]()
        print(f"made {name}", flush=True)


if __name__ == "__main__":
    main()
