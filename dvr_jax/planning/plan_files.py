"""The files of a plan: `plan.json` and `trajectory.npz`, from which it is read back, a MuJoCo scene and pictures."""

from __future__ import annotations

import hashlib
import math
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from dvr_jax.checker import CheckReport
from dvr_jax.errors import DataError, DvrError
from dvr_jax.logic import Action, Grounding
from dvr_jax.motion.file import encode_motion, load_motion
from dvr_jax.motion.motion import Motion
from dvr_jax.operators import Operator, ground_scene
from dvr_jax.planning.path_quality import PathQuality
from dvr_jax.runtime.files import read_whole, require_folder, write_together
from dvr_jax.scene.files import scene_from_json, scene_to_json
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.scene.mjcf import scene_xml
from dvr_jax.scene.types import Scene
from dvr_jax.search.explanation import Refutation
from dvr_jax.search.reasons import Reason, ReasonKind
from dvr_jax.search.status import PlanStatus

if TYPE_CHECKING:
    from dvr_jax.planning.result import Plan

PLAN = "plan.json"
TRAJECTORY = "trajectory.npz"
MUJOCO_SCENE = "scene.xml"
DEPTH_PICTURE = "depth.png"
FILM = "film.png"
ANIMATION = "plan.gif"

LARGEST_PLAN = 1 << 26
"""Bytes of the largest plan.json that is read; one has some kilobytes."""


class _ActionFile(msgspec.Struct):
    """One action in plan.json."""

    operator: str
    arguments: tuple[str, ...]


class _ReasonFile(msgspec.Struct, forbid_unknown_fields=True):
    """A reason in plan.json."""

    kind: ReasonKind
    action: str
    bodies: tuple[str, ...]
    amount: float | None
    """None if it is not known."""
    sentence: str
    confirmed: bool = True


class _RefutationFile(msgspec.Struct, forbid_unknown_fields=True):
    """A refuted sequence in plan.json."""

    actions: tuple[_ActionFile, ...]
    bound: str
    reason: _ReasonFile


class _PlanFile(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Content of plan.json; the fields mean what the fields of `Plan` mean."""

    status: PlanStatus
    actions: tuple[_ActionFile, ...]
    action_descriptions: tuple[str, ...]
    nlps: dict[str, int]
    verdicts: dict[str, int]
    rejected_by_check: int
    seconds: dict[str, float]
    path: PathQuality | None
    violations: dict[str, float]
    check: CheckReport | None
    reason: _ReasonFile | None = None
    refuted: tuple[_RefutationFile, ...] = ()
    options: dict[str, bool | str | int | float | None]
    scene: msgspec.Raw
    versions: dict[str, str]
    """Versions of Python and of the packages that made the plan."""
    checksum: str | None = None
    """SHA-256 of the file as it is without this; files before version 0.10 have none."""


def save_plan(folder: Path, plan: Plan, pictures: bool, animation: bool) -> None:
    """Write everything that is known of a plan into a folder, in place of another plan's files.

    Those stay until all files of this one are complete. plan.json comes last, so that it is there only together with
    the files that it describes.

    Args:
        folder: Folder for the files; it is made if it is missing.
        plan: Plan to write.
        pictures: Whether to write pictures of the scene and of the plan.
        animation: Whether to write the animation.

    Raises:
        OSError: A file cannot be written.
    """
    # Imported here, because drawing takes half a second that other uses of a plan need not wait for.
    from dvr_jax.drawing.animation import encode_animation
    from dvr_jax.drawing.depth_picture import encode_depth_picture
    from dvr_jax.drawing.film import encode_film

    require_folder(folder)
    contents = {PLAN: encode_plan(plan), MUJOCO_SCENE: scene_xml(plan.scene).encode()}
    if pictures:
        contents[DEPTH_PICTURE] = encode_depth_picture(plan.scene)

    if plan.motion is not None:
        contents[TRAJECTORY] = encode_motion(plan.motion)
        if pictures:
            contents[FILM] = encode_film(plan.scene, plan.action_descriptions, plan.motion)
        if animation:
            contents[ANIMATION] = encode_animation(plan.scene, plan.motion)

    write_together(folder, contents, last=PLAN, stale=(TRAJECTORY, DEPTH_PICTURE, FILM, ANIMATION))


def encode_plan(plan: Plan) -> bytes:
    """Return the content of plan.json: indented JSON with a final line break."""
    versions = {name: version(name) for name in ("dvr_jax", "jax", "mujoco", "numpy")}

    record = _PlanFile(
        status=plan.status,
        actions=_encode_actions(plan.actions),
        action_descriptions=plan.action_descriptions,
        nlps=plan.nlps,
        verdicts=plan.verdicts,
        rejected_by_check=plan.rejected,
        seconds={stage: float(value) for stage, value in plan.seconds.items()},
        path=plan.path,
        violations={kind: float(value) for kind, value in plan.violations.items()},
        check=plan.report,
        reason=None if plan.reason is None else _encode_reason(plan.reason),
        refuted=tuple(
            _RefutationFile(_encode_actions(item.actions), item.bound, _encode_reason(item.reason))
            for item in plan.refuted
        ),
        options=plan.options,  # type: ignore[arg-type]
        scene=msgspec.Raw(scene_to_json(plan.scene).encode()),
        versions={"python": platform.python_version(), **versions},
    )
    record.checksum = _checksum_of(record)
    return msgspec.json.format(msgspec.json.encode(record), indent=1) + b"\n"


def _encode_actions(actions: Sequence[Action]) -> tuple[_ActionFile, ...]:
    """Return actions as they stand in plan.json."""
    return tuple(_ActionFile(action.operator, action.arguments) for action in actions)


def _encode_reason(reason: Reason) -> _ReasonFile:
    """Return a reason as it stands in plan.json."""
    amount = reason.amount if math.isfinite(reason.amount) else None
    return _ReasonFile(
        reason.kind, reason.action, reason.bodies, amount, reason.sentence, reason.confirmed
    )


def _decode_reason(record: _ReasonFile) -> Reason:
    """Return the reason of a record."""
    amount = math.nan if record.amount is None else record.amount
    return Reason(
        record.kind, record.action, record.bodies, amount, record.sentence, record.confirmed
    )


def _decode_refutation(record: _RefutationFile) -> Refutation:
    """Return the refuted sequence of a record."""
    actions = tuple(Action(item.operator, item.arguments) for item in record.actions)
    return Refutation(actions, record.bound, _decode_reason(record.reason))


def load_plan_fields(folder: Path, operators: Sequence[Operator]) -> dict[str, Any]:
    """Read the files of a plan and return the fields of `Plan` by their names.

    Args:
        folder: Folder that a plan was saved to.
        operators: Operators that the plan's actions may be of.

    Raises:
        DataError: The folder holds no plan, or its files are broken or contradict each other.
        DvrError: The scene or the motion in the folder is broken.
    """
    path = folder / PLAN
    record = _read_record(path)
    scene = scene_from_json(bytes(record.scene), f"{path}, scene")
    actions = tuple(Action(item.operator, item.arguments) for item in record.actions)

    motion = None
    if record.status == PlanStatus.SOLVED:
        motion = _load_fitting_motion(folder, scene, actions)
    _require_agreement(path, record, ground_scene(scene, operators), actions)

    return {
        "scene": scene,
        "status": record.status,
        "actions": actions,
        "motion": motion,
        "report": record.check,
        "path": record.path,
        "violations": record.violations,
        "seconds": record.seconds,
        "nlps": record.nlps,
        "verdicts": record.verdicts,
        "rejected": record.rejected_by_check,
        "reason": None if record.reason is None else _decode_reason(record.reason),
        "refuted": tuple(map(_decode_refutation, record.refuted)),
        "options": dict(record.options),
        "operators": tuple(operators),
    }


def _read_record(path: Path) -> _PlanFile:
    """Read plan.json; refuse what has not its form."""
    try:
        content = read_whole(path, LARGEST_PLAN)
    except (FileNotFoundError, NotADirectoryError):
        raise DataError(
            f"there is no file {path}; valid is a folder that a plan was saved to."
        ) from None

    try:
        record = msgspec.json.decode(content, type=_PlanFile)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise DataError(f"{path} holds no plan of this version: {reason}.") from None

    if record.checksum is not None and record.checksum != _checksum_of(record):
        raise DataError(f"{path} is not as it was written: its checksum is another one.")
    return record


def _checksum_of(record: _PlanFile) -> str:
    """Return the SHA-256 of a record without its checksum, whatever white space its file has."""
    scene = msgspec.Raw(msgspec.json.format(bytes(record.scene), indent=-1))
    plain = msgspec.structs.replace(record, checksum=None, scene=scene)
    return hashlib.sha256(msgspec.json.encode(plain)).hexdigest()


def _load_fitting_motion(folder: Path, scene: Scene, actions: tuple[Action, ...]) -> Motion:
    """Read trajectory.npz; refuse a motion of another scene or with another number of actions."""
    path = folder / TRAJECTORY
    if not path.exists():
        raise DataError(
            f"{folder / PLAN} says that the plan is solved, but there is no file {path}."
        )

    motion = load_motion(path)
    columns = qpos_layout(scene).size
    if motion.qpos.shape[1] != columns:
        raise DataError(
            f"the states of {path} have {motion.qpos.shape[1]} numbers; the plan's scene has {columns}."
        )
    if len(motion.switch) != len(actions):
        raise DataError(
            f"{path} has {len(motion.switch)} switches; the plan has {len(actions)} actions."
        )

    return motion


def _require_agreement(
    path: Path, record: _PlanFile, grounding: Grounding, actions: tuple[Action, ...]
) -> None:
    """Refuse a plan whose status, actions and check contradict each other."""
    if record.status != PlanStatus.SOLVED:
        if actions or record.check is not None:
            raise DataError(
                f"{path} has actions or a check, but its status is {record.status.value!r}."
            )
        return

    if record.check is None or not record.check.passed:
        raise DataError(f"{path} says that the plan is solved, but not that it passed the check.")

    # Where the goal holds from the start, no action is needed; the rules know only what actions bring about.
    if not actions:
        return

    try:
        grounding.check_sequence(actions)
    except DvrError as error:
        raise DataError(f"the actions in {path} do not solve its scene: {error}") from None
