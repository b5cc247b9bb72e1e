"""The records of scene files, versions 1 and 2, and what a broken file is told. Its JSON Schema: `scene.schema.json`.

Version 1 (meters, radians, full extents; the table's top is z = 0; "home" and each of its arms may be left out):

    {"version": 1,
     "objects": [{"name": "yellow", "shape": "box", "size": [sx, sy, sz], "position": [x, y], "yaw": r},
                 {"name": "can", "shape": "cylinder", "size": [radius, height], "position": [x, y], "yaw": r}],
     "goal": {"object": "yellow", "region": {"position": [x, y], "yaw": r, "size": [sx, sy]}},
     "home": {"left": [7 joint angles], "right": [7 joint angles]}}

An object may also have "density" [kg/m^3] and "friction", the coefficient of sliding friction. In version 2 it may also
have "support", the name of the fixed body on whose top it stands.

Version 2 says where the arms stand and what else does. It has no "home", as each arm has its own; "workcell", "fixed",
and of the workcell each arm's "home" and the "table" may be left out:

    {"version": 2, "objects": [...], "goal": {...},
     "workcell": {"robot": "panda",
                  "arms": [{"name": "left", "position": [x, y], "yaw": r, "home": [7 joint angles]}],
                  "table": {"half_extents": [x, y], "thickness": t}},
     "fixed": [{"name": "wall", "shape": "box", "size": [sx, sy, sz], "position": [x, y, z], "yaw": r}]}

Its goal may also be a list of facts about named regions; "support" and "inside" of a region may be left out:

     "regions": [{"name": "plate", "position": [x, y], "yaw": r, "size": [sx, sy],
                  "support": "table" or a fixed body, "inside": "footprint" or "center"}],
     "goal": [["on", "yellow", "plate"], ["holding", "left", "can"], ["hands_empty"], ["clear", "plate"]]
"""

import json
import re
from typing import Literal

import msgspec

from dvr_jax.errors import SceneError
from dvr_jax.goals import TABLE, Inside

Record = msgspec.Struct


class ObjectRecord(Record, forbid_unknown_fields=True, omit_defaults=True):
    """One object; without "density" and "friction" it has the usual ones, without "support" it stands on the table."""

    name: str
    shape: str
    size: tuple[float, ...]
    position: tuple[float, float]
    yaw: float
    density: float | None = None
    friction: float | None = None
    support: str | None = None


class RegionRecord(Record, forbid_unknown_fields=True):
    """The goal region."""

    position: tuple[float, float]
    yaw: float
    size: tuple[float, float]


class NamedRegionRecord(Record, forbid_unknown_fields=True, omit_defaults=True):
    """One region; without "support" it lies on the table, without "inside" it holds whole footprints."""

    name: str
    position: tuple[float, float]
    yaw: float
    size: tuple[float, float]
    support: str = TABLE
    inside: Inside = Inside.FOOTPRINT


FactRecord = tuple[str, ...]
"""One fact of the goal: its keyword and its arguments."""


class GoalRecord(Record, forbid_unknown_fields=True):
    """The goal that is one object on a region of its own."""

    object: str
    region: RegionRecord


class HomeRecord(Record, forbid_unknown_fields=True, omit_defaults=True):
    """Home postures of version 1; an arm without one has the robot's usual posture."""

    left: tuple[float, ...] | None = None
    right: tuple[float, ...] | None = None


class ArmRecord(Record, forbid_unknown_fields=True, omit_defaults=True):
    """One arm; without "home" it has the robot's usual posture."""

    name: str
    position: tuple[float, float]
    yaw: float
    home: tuple[float, ...] | None = None


class TableRecord(Record, forbid_unknown_fields=True):
    """The table."""

    half_extents: tuple[float, float]
    thickness: float


class WorkcellRecord(Record, forbid_unknown_fields=True, omit_defaults=True):
    """Arms and table; without "table" it is the usual one."""

    robot: str
    arms: tuple[ArmRecord, ...]
    table: TableRecord | None = None


class FixedRecord(Record, forbid_unknown_fields=True):
    """One fixed body."""

    name: str
    shape: str
    size: tuple[float, ...]
    position: tuple[float, float, float]
    yaw: float


class SceneRecord1(Record, forbid_unknown_fields=True, omit_defaults=True):
    """A scene file of version 1."""

    version: Literal[1]
    objects: tuple[ObjectRecord, ...]
    goal: GoalRecord
    home: HomeRecord | None = None


class SceneRecord2(Record, forbid_unknown_fields=True, omit_defaults=True):
    """A scene file of version 2; without "workcell" it is the usual one."""

    version: Literal[2]
    objects: tuple[ObjectRecord, ...]
    goal: GoalRecord | tuple[FactRecord, ...]
    workcell: WorkcellRecord | None = None
    fixed: tuple[FixedRecord, ...] = ()
    regions: tuple[NamedRegionRecord, ...] = ()


SceneRecord = SceneRecord1 | SceneRecord2


class _VersionRecord(Record):
    """What a file must say before anything else of it can be judged."""

    version: Literal[1, 2]


_FORMATS: dict[int, type[SceneRecord1] | type[SceneRecord2]] = {
    1: SceneRecord1,
    2: SceneRecord2,
}

_PLACES: dict[str, type[Record]] = {
    "objects[]": ObjectRecord,
    "goal": GoalRecord,
    "goal.region": RegionRecord,
    "home": HomeRecord,
    "workcell": WorkcellRecord,
    "workcell.arms[]": ArmRecord,
    "workcell.table": TableRecord,
    "fixed[]": FixedRecord,
    "regions[]": NamedRegionRecord,
}
"""Record at each place of a scene file below its top."""


def decode_scene(text: str | bytes) -> SceneRecord:
    """Read the record that a scene file holds.

    Raises:
        SceneError: The text is no JSON, or no scene; the message says where and what would be valid.
    """
    version = 1
    try:
        version = msgspec.json.decode(text, type=_VersionRecord).version
        record = msgspec.json.decode(text, type=_FORMATS[version])
        # msgspec silently takes the last one of several equal keys.
        json.loads(text, object_pairs_hook=_refuse_equal_keys, parse_int=float)
    except RecursionError:
        raise SceneError("not valid JSON (it is nested too deeply).") from None
    except (msgspec.DecodeError, ValueError) as error:
        raise SceneError(_explain(str(error), version)) from None

    return record


def encode_scene(record: SceneRecord) -> str:
    """Write a record as one line of JSON."""
    return msgspec.json.encode(record).decode()


def _refuse_equal_keys(pairs: list[tuple[str, object]]) -> None:
    keys = [key for key, _ in pairs]
    for key in keys:
        if keys.count(key) > 1:
            raise SceneError(
                f"the scene: the key `{key}` occurs {keys.count(key)} times; each key may occur once."
            )


def _explain(message: str, version: int) -> str:
    """A decoder's message as one sentence: where, what, and the valid keys where a key is at fault."""
    found = re.fullmatch(r"(?P<what>.*?)(?: - at `\$\.?(?P<where>.*)`)?", message, flags=re.DOTALL)
    assert found is not None
    where = found["where"] or ""
    what = found["what"].rstrip(".")
    if "malformed" in what or "truncated" in what:
        return f"not valid JSON ({what}){_json_hint(what)}."

    place = re.sub(r"\[\d+\]", "[]", where)
    record = _PLACES.get(place) if place else _FORMATS[version]
    if "unknown field" in what and record is not None:
        what += f"; valid keys are {', '.join(record.__struct_fields__)}"
    elif "missing required field" in what:
        what += "; add it"
    elif where == "version":
        what += f"; valid are {' and '.join(map(str, _FORMATS))}"

    return f"{where or 'the scene'}: {what}."


def _json_hint(what: str) -> str:
    """What a file with this fault should have been."""
    if "invalid character" in what:
        return "; NaN and infinity are no JSON numbers"
    if "trailing characters" in what:
        return "; valid is one scene, and in a file of scenes one a line"

    return ""
