"""Scenes as files: one JSON object a scene, or JSON Lines for many. This is the edge where input is refused.

Format (version 1; metres, radians, full extents; the table's top is z = 0; "home" and each of its arms optional):

    {"version": 1,
     "objects": [{"name": "yellow", "shape": "box", "size": [sx, sy, sz], "position": [x, y], "yaw": r},
                 {"name": "can", "shape": "cylinder", "size": [radius, height], "position": [x, y], "yaw": r}],
     "goal": {"object": "yellow", "region": {"position": [x, y], "yaw": r, "size": [sx, sy]}},
     "home": {"left": [7 joint angles], "right": [7 joint angles]}}

The records themselves live in `types`, the rules in `validation`; both are named here again, for one import.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import astuple
from pathlib import Path
from typing import Literal

import msgspec

from dvr_jax.errors import DvrError
from dvr_jax.scene.types import DEFAULT_HOME, Goal, Region, Scene, SceneObject, Shape
from dvr_jax.scene.validation import make_scene, validate_scene

__all__ = [
    "DEFAULT_HOME",
    "Goal",
    "Region",
    "Scene",
    "SceneObject",
    "Shape",
    "are_equal_but_for_rounding",
    "load_scene",
    "load_scenes",
    "make_scene",
    "save_scene",
    "save_scenes",
    "scene_from_json",
    "scene_to_json",
    "validate_scene",
]


ROUNDING = 1e-9
"""Numbers that differ by no more are the same [m, rad]."""


class _ObjectFile(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    shape: Literal["box", "cylinder"]
    size: list[float]
    position: tuple[float, float]
    yaw: float


class _RegionFile(msgspec.Struct, forbid_unknown_fields=True):
    position: tuple[float, float]
    yaw: float
    size: tuple[float, float]


class _GoalFile(msgspec.Struct, forbid_unknown_fields=True):
    object: str
    region: _RegionFile


class _HomeFile(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    left: list[float] | None = None
    right: list[float] | None = None


class _SceneFile(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    version: Literal[1]
    objects: list[_ObjectFile]
    goal: _GoalFile
    home: _HomeFile | None = None


_FIELDS = {
    "": _SceneFile.__struct_fields__,
    "objects[]": _ObjectFile.__struct_fields__,
    "goal": _GoalFile.__struct_fields__,
    "goal.region": _RegionFile.__struct_fields__,
    "home": _HomeFile.__struct_fields__,
}
"""Valid keys at each place of a scene file."""


def scene_from_json(text: str | bytes, source: str = "scene") -> Scene:
    """The valid scene that `text` holds; a DvrError starts with `source` (a file, a line) and names what is wrong."""
    try:
        record = msgspec.json.decode(text, type=_SceneFile)
    except (msgspec.DecodeError, UnicodeError) as error:
        raise DvrError(f"{source}: {_explain(str(error))}") from None
    objects = tuple(
        SceneObject(item.name, item.shape, tuple(item.size), item.position, item.yaw) for item in record.objects
    )
    region = record.goal.region
    goal = Goal(record.goal.object, Region(region.position, region.yaw, region.size))
    home = record.home or _HomeFile()
    postures = tuple(
        default if given is None else tuple(given)
        for given, default in zip((home.left, home.right), DEFAULT_HOME, strict=True)
    )
    try:
        return make_scene(objects, goal, (postures[0], postures[1]))
    except DvrError as error:
        raise DvrError(f"{source}: {error}") from None


def scene_to_json(scene: Scene) -> str:
    """The scene as one line of JSON; `scene_from_json` gives an equal scene back."""
    region = scene.goal.region
    home = None
    if scene.home != DEFAULT_HOME:
        home = _HomeFile(
            *(None if own == usual else list(own) for own, usual in zip(scene.home, DEFAULT_HOME, strict=True))
        )
    record = _SceneFile(
        version=1,
        objects=[
            _ObjectFile(item.name, item.shape, list(item.size), item.position, item.yaw) for item in scene.objects
        ],
        goal=_GoalFile(scene.goal.object, _RegionFile(region.position, region.yaw, region.size)),
        home=home,
    )
    return msgspec.json.encode(record).decode()


def are_equal_but_for_rounding(first: Scene, second: Scene) -> bool:
    """Whether all numbers of two scenes agree to 1e-9 m or rad, and all else is equal: processors round the last bit
    of a sine differently, and so draw a scene of one seed."""
    ours, theirs = list(_values(astuple(first))), list(_values(astuple(second)))
    return len(ours) == len(theirs) and all(
        abs(a - b) <= ROUNDING if isinstance(a, float) and isinstance(b, float) else a == b
        for a, b in zip(ours, theirs, strict=True)
    )


def _values(parts: Iterable[object]) -> Iterator[object]:
    for part in parts:
        if isinstance(part, tuple):
            yield from _values(part)
        else:
            yield part


def load_scene(path: str | Path) -> Scene:
    """The scene of one JSON file. Raises DvrError for bad content, OSError for a file that cannot be read."""
    return scene_from_json(Path(path).read_bytes(), str(path))


def load_scenes(path: str | Path) -> tuple[Scene, ...]:
    """All scenes of a JSON Lines file, in order; blank lines are skipped. Errors name file and line."""
    lines = Path(path).read_bytes().split(b"\n")
    scenes = tuple(
        scene_from_json(line, f"{path}, line {number}") for number, line in enumerate(lines, start=1) if line.strip()
    )
    if not scenes:
        raise DvrError(f"{path} holds no scene; valid is one JSON object a line.")
    return scenes


def save_scene(path: str | Path, scene: Scene) -> None:
    """Write one scene as indented JSON."""
    text = msgspec.json.format(scene_to_json(scene), indent=2)
    Path(path).write_text(text + "\n", encoding="utf-8")


def save_scenes(path: str | Path, scenes: "list[Scene] | tuple[Scene, ...]") -> None:
    """Write scenes as JSON Lines; folders above the file that do not exist are made."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(scene_to_json(scene) + "\n" for scene in scenes), encoding="utf-8")


def _explain(message: str) -> str:
    """A decoder's message as one sentence: where, what, and the valid keys where a key is at fault."""
    found = re.fullmatch(r"(?P<what>.*?)(?: - at `\$\.?(?P<where>.*)`)?", message, flags=re.DOTALL)
    assert found is not None
    where = found["where"] or ""
    what = found["what"].rstrip(".")
    if "malformed" in what or "truncated" in what:
        reason = {
            "invalid character": "; NaN and infinity are no JSON numbers",
            "trailing characters": "; valid is one scene, and in a file of scenes one a line",
        }
        return f"not valid JSON ({what}){next((hint for key, hint in reason.items() if key in what), '')}."
    keys = _FIELDS.get(re.sub(r"\[\d+\]", "[]", where))
    if "unknown field" in what and keys is not None:
        what += f"; valid keys are {', '.join(keys)}"
    elif "missing required field" in what:
        what += "; add it"
    elif where == "version":
        what += "; the only valid version is 1"
    elif where.endswith("shape"):
        what += "; valid are 'box' and 'cylinder'"
    return f"{where or 'the scene'}: {what}."
