"""A robot arm with a parallel gripper: its MuJoCo model, and the constants that are read from it.

The MJCF text is the one source of every number. Its conventions:

- bodies ``base``, ``link1`` .. ``linkJ``, ``hand``, ``finger_left``, ``finger_right``; link i moves with the joints
  ``joint1`` .. ``jointi``, each of which turns about its own z axis;
- slide joints ``finger_joint_left`` and ``finger_joint_right`` that open the gripper by the same travel;
- a site ``gripper`` at the gripper center: its axes are those of the hand (y closes, z approaches);
- collision capsules named ``NAME_collision``, ordered from the base outwards; they are the only geoms that collide;
- under ``<custom>`` what MJCF has no element for: see `dvr_jax/workcell/panda/panda.xml`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from dvr_jax.errors import DvrError

Rectangle = tuple[tuple[int, int], tuple[int, int]]
"""A set of capsule pairs: every capsule of the first range with every capsule of the second range, each range given as
(first, one past the last)."""

FINGERS = ("finger_left", "finger_right")
"""Bodies of the two fingers; the joint of each is called ``finger_joint_left`` or ``finger_joint_right``."""


@dataclass(frozen=True)
class InverseKinematics:
    """A closed-form inverse kinematics of a robot."""

    solve: Callable[..., Any]
    """Called as ``solve(robot_model, R, p, free)`` with gripper poses in the frame of the arm's base: axes ``R``
    (3, 3, L), centers ``p`` (3, L) [m], and the angles ``free`` (F, L) [rad] of the free joints. Returns angles
    (J, branches, L) [rad] and by how much each branch fails (branches, L): 0 where it reaches the pose within the joint
    limits, else a positive number that grows with the distance from feasibility."""

    branches: int
    """Number of solutions for each pose and each choice of the free angles."""

    free_joints: tuple[int, ...] = ()
    """Joints, counted from 0, whose angles are chosen freely: a redundant arm of seven joints has one."""

    def __repr__(self) -> str:
        """Name the function, so that compiled programs can be stored under it."""
        inside = self.solve.__module__.startswith("dvr_jax.")
        name = f"{self.solve.__module__}.{self.solve.__qualname__}"
        return f"InverseKinematics({name if inside else f'<{name}>'}, {self.branches}, {self.free_joints})"


@dataclass(frozen=True, slots=True)
class BaseFoot:
    """The area of the table that a base covers; no object may stand on it."""

    radius: float
    """Radius of the disc around the first joint's axis [m]."""

    length: float
    """Length of the plate, from the axis to behind it [m]."""

    width: float
    """Width of the plate [m]."""


@dataclass(frozen=True, eq=False)
class Capsules:
    """The C collision capsules of one arm, from the base outwards."""

    names: tuple[str, ...]
    """Names without the suffix ``_collision``."""

    links: tuple[int, ...]
    """Link that each capsule moves with; 0 is the base."""

    starts: Float[np.ndarray, "capsules 3"]
    """First ends of the segments in their link frames, with closed fingers [m]."""

    ends: Float[np.ndarray, "capsules 3"]
    """Second ends [m]."""

    radii: Float[np.ndarray, " capsules"]
    """Radii [m]."""

    finger_directions: Float[np.ndarray, "capsules 3"]
    """Direction in the link frame in which a finger's capsule moves as the gripper opens; zero for all others."""

    def range_of(self, names: str) -> tuple[int, int]:
        """Return the range (first, one past the last) of capsules that are named in a row, in their order.

        Raises:
            DvrError: There is no name, an unknown one, or the capsules are not consecutive.
        """
        indices = self.indices_of(names)
        if not indices:
            raise DvrError(
                f"a list of capsules names no capsule; valid is a part of '{' '.join(self.names)}'."
            )
        if indices != tuple(range(indices[0], indices[0] + len(indices))):
            listed = " ".join(names.split())
            raise DvrError(
                f"the capsules '{listed}' are not consecutive; valid is a part of '{' '.join(self.names)}'."
            )
        return indices[0], indices[-1] + 1

    def indices_of(self, names: str) -> tuple[int, ...]:
        """Return the indices of capsules that are named in a row.

        Raises:
            DvrError: There is no capsule of one of the names.
        """
        for name in names.split():
            if name not in self.names:
                raise DvrError(f"there is no capsule '{name}'; valid are {', '.join(self.names)}.")
        return tuple(self.names.index(name) for name in names.split())


@dataclass(frozen=True)
class Robot:
    """A robot arm with a parallel gripper.

    Two robots are equal if their three fields are; everything else follows from the MJCF and is read when it is first
    asked for.
    """

    name: str
    """Name under which scene files refer to it."""

    mjcf: str = field(repr=False)
    """The MuJoCo model of one arm as XML text; see the module's docstring for its conventions."""

    inverse_kinematics: InverseKinematics = field(repr=False)
    """The closed-form inverse kinematics."""

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The compiled MuJoCo model of one arm; not to be changed."""
        try:
            return mujoco.MjModel.from_xml_string(self.mjcf)
        except ValueError as error:
            reason = " ".join(str(error).split()).rstrip(".")
            raise DvrError(
                f"MuJoCo refuses the MJCF of the robot '{self.name}': {reason}."
            ) from None

    @cached_property
    def number_of_joints(self) -> int:
        """Number J of revolute joints, the fingers not counted."""
        return sum(self.model.joint(i).name.startswith("joint") for i in range(self.model.njnt))

    @cached_property
    def joint_limits(self) -> Float[np.ndarray, "2 joints"]:
        """Lower and upper joint limits [rad]."""
        return np.stack(
            [self._joint(f"joint{i + 1}").range for i in range(self.number_of_joints)], axis=1
        )

    @cached_property
    def joint_velocity(self) -> Float[np.ndarray, " joints"]:
        """Largest joint velocities [rad/s]."""
        return self._numbers("joint_velocity", self.number_of_joints)

    @cached_property
    def joint_acceleration(self) -> Float[np.ndarray, " joints"]:
        """Largest joint accelerations [rad/s^2]."""
        return self._numbers("joint_acceleration", self.number_of_joints)

    @cached_property
    def joint_jerk(self) -> Float[np.ndarray, " joints"]:
        """Largest joint jerks [rad/s^3]; infinite where the MJCF states none."""
        return self._numbers_or_infinity("joint_jerk")

    @cached_property
    def joint_torque(self) -> Float[np.ndarray, " joints"]:
        """Largest joint torques [N m]; infinite where the MJCF states none."""
        return self._numbers_or_infinity("joint_torque")

    @cached_property
    def finger_speed(self) -> float:
        """Largest speed of one finger [m/s]."""
        return float(self._numbers("finger_speed", 1)[0])

    @cached_property
    def finger_travel(self) -> float:
        """Largest travel of one finger from closed to open [m]."""
        return float(self._joint("finger_joint_left").range[1])

    @property
    def maximum_opening(self) -> float:
        """Width of the widest object that the gripper can take [m]."""
        return 2 * self.finger_travel

    @cached_property
    def home(self) -> tuple[float, ...]:
        """The customary ready posture: joint angles [rad]."""
        return tuple(float(angle) for angle in self._numbers("home", self.number_of_joints))

    @cached_property
    def tucked(self) -> tuple[float, ...]:
        """A posture that keeps the arm out of the way of another one: joint angles [rad]."""
        return tuple(float(angle) for angle in self._numbers("tucked", self.number_of_joints))

    @cached_property
    def base_foot(self) -> BaseFoot:
        """The area of the table that the base covers."""
        radius, length, width = self._numbers("base_foot", 3)
        return BaseFoot(float(radius), float(length), float(width))

    @cached_property
    def link_rotations(self) -> Float[np.ndarray, "joints 3 3"]:
        """Rotation of link frame i + 1 in link frame i at joint angle zero."""
        return np.stack([_rotation_matrix(self._body(name).quat) for name in self._link_names[1:]])

    @cached_property
    def link_offsets(self) -> Float[np.ndarray, "joints 3"]:
        """Origin of link frame i + 1 in link frame i [m]."""
        return np.stack([self._body(name).pos for name in self._link_names[1:]])

    @cached_property
    def hand_rotation(self) -> Float[np.ndarray, "3 3"]:
        """Rotation of the hand frame in the last link's frame."""
        return self._pose_in_link("hand")[1]

    @cached_property
    def gripper_center(self) -> Float[np.ndarray, " 3"]:
        """Point between the finger tips, in the last link's frame [m]."""
        _, rotation, position = self._pose_in_link("hand")
        return position + rotation @ self._site("gripper").pos

    @cached_property
    def capsules(self) -> Capsules:
        """The collision capsules, from the base outwards."""
        geoms = [self.model.geom(i) for i in range(self.model.ngeom)]
        colliding = [geom for geom in geoms if geom.name.endswith("_collision")]
        links: list[int] = []
        starts: list[np.ndarray] = []
        ends: list[np.ndarray] = []
        directions: list[np.ndarray] = []
        for geom in colliding:
            if geom.type[0] != mujoco.mjtGeom.mjGEOM_CAPSULE:
                raise DvrError(
                    f"the geom '{geom.name}' of the robot '{self.name}' is no capsule; valid are capsules."
                )
            body = self.model.body(geom.bodyid[0]).name
            link, rotation, position = self._pose_in_link(body)
            center = rotation @ geom.pos + position
            half_axis = rotation @ _rotation_matrix(geom.quat)[:, 2] * geom.size[1]
            links.append(link)
            starts.append(center - half_axis)
            ends.append(center + half_axis)
            directions.append(rotation @ self._slide_axis(body))

        return Capsules(
            names=tuple(geom.name.removesuffix("_collision") for geom in colliding),
            links=tuple(links),
            starts=np.array(starts),
            ends=np.array(ends),
            radii=np.array([geom.size[0] for geom in colliding]),
            finger_directions=np.array(directions),
        )

    @cached_property
    def holding_capsules(self) -> tuple[int, ...]:
        """Capsules that touch what the hand holds."""
        return self.capsules.indices_of(self._text("holding"))

    @cached_property
    def table_capsules(self) -> tuple[int, int]:
        """Range of the capsules that can reach the table."""
        return self.capsules.range_of(self._text("above_table"))

    @cached_property
    def self_collision_pairs(self) -> tuple[Rectangle, ...]:
        """Pairs of capsules of one arm that can meet within the joint limits."""
        rectangles = []
        for line in self._text("self_collision").split(";"):
            near, colon, far = line.partition(":")
            if not colon and not line.strip():
                continue
            if not colon:
                listed = " ".join(line.split())
                raise DvrError(
                    f"the <text name=\"self_collision\"> of the robot '{self.name}' says '{listed}'; "
                    "valid is 'these : with these'."
                )
            rectangles.append((self.capsules.range_of(near), self.capsules.range_of(far)))
        return tuple(rectangles)

    @cached_property
    def capsule_reach(self) -> Float[np.ndarray, " capsules"]:
        """Upper bound of the horizontal distance of each capsule's surface from the first joint's axis [m].

        A point of link i is no farther away than the horizontal offset of link 1 and the lengths of all further
        offsets together.
        """
        lengths = np.linalg.norm(self.link_offsets, axis=1)
        lengths[0] = np.linalg.norm(self.link_offsets[0, :2])
        reach = np.concatenate([[0.0], np.cumsum(lengths)])
        capsules = self.capsules
        bounds = []
        for c, link in enumerate(capsules.links):
            slide = self.finger_travel * capsules.finger_directions[c]
            points = np.stack(
                [
                    capsules.starts[c],
                    capsules.ends[c],
                    capsules.starts[c] + slide,
                    capsules.ends[c] + slide,
                ]
            )
            # The base and link 1 keep their heights: joint 1 turns about the vertical.
            upright = link == 0 or (link == 1 and abs(self.link_rotations[0, 2, 2]) == 1)
            own = points[:, :2] if upright else points
            bounds.append(reach[link] + np.linalg.norm(own, axis=1).max() + capsules.radii[c])
        return np.array(bounds)

    @cached_property
    def pad_overhang(self) -> float:
        """How far the fingers' capsules reach beyond the pads, into the room of what is grasped [m].

        The pads of a closed gripper meet in the hand's middle plane. A finger's capsule moves away from it along
        `Capsules.finger_directions`.
        """
        capsules = self.capsules
        hand_position = self._pose_in_link("hand")[2]
        moves = np.linalg.norm(capsules.finger_directions, axis=1) > 0
        directions = capsules.finger_directions[moves]
        reach = [
            radius - min(float(direction @ (end - hand_position)) for end in ends)
            for direction, radius, *ends in zip(
                directions,
                capsules.radii[moves],
                capsules.starts[moves],
                capsules.ends[moves],
                strict=True,
            )
        ]
        return max([0.0, *reach])

    @property
    def _link_names(self) -> list[str]:
        return ["base", *(f"link{i + 1}" for i in range(self.number_of_joints))]

    def _body(self, name: str) -> Any:
        """MuJoCo's view of a body."""
        return self._view("body", self.model.body, name)

    def _joint(self, name: str) -> Any:
        """MuJoCo's view of a joint."""
        return self._view("joint", self.model.joint, name)

    def _site(self, name: str) -> Any:
        """MuJoCo's view of a site."""
        return self._view("site", self.model.site, name)

    def _view(self, kind: str, look_up: Callable[[str], Any], name: str) -> Any:
        try:
            return look_up(name)
        except KeyError:
            raise DvrError(
                f"the MJCF of the robot '{self.name}' lacks the {kind} '{name}'; "
                "the names that it must have are listed in dvr_jax/workcell/robot.py."
            ) from None

    def _numbers(self, name: str, count: int) -> Float[np.ndarray, " count"]:
        """Values of a ``<numeric>`` of the MJCF, which are so many."""
        index = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
        if index < 0:
            raise DvrError(
                f"the MJCF of the robot '{self.name}' lacks the <numeric name=\"{name}\"> under <custom>."
            )
        values = np.array(self.model.numeric(index).data)
        if len(values) != count:
            raise DvrError(
                f"the <numeric name=\"{name}\"> of the robot '{self.name}' has {len(values)} numbers; "
                f"valid are {count}."
            )
        return values

    def _numbers_or_infinity(self, name: str) -> Float[np.ndarray, " joints"]:
        """Values of a ``<numeric>`` of the MJCF that need not be there, one for each joint."""
        if mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_NUMERIC, name) < 0:
            return np.full(self.number_of_joints, np.inf)
        return self._numbers(name, self.number_of_joints)

    def _text(self, name: str) -> str:
        """Value of a ``<text>`` of the MJCF."""
        index = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_TEXT, name)
        if index < 0:
            raise DvrError(
                f"the MJCF of the robot '{self.name}' lacks the <text name=\"{name}\"> under <custom>."
            )
        first = int(self.model.text_adr[index])
        size = int(self.model.text_size[index])
        return bytes(self.model.text_data[first : first + size]).decode().rstrip("\0")

    def _slide_axis(self, body: str) -> Float[np.ndarray, " 3"]:
        """Axis of the slide joint of a body in its own frame; zero where it has none."""
        joint = int(self.model.body(body).jntadr[0])
        slides = joint >= 0 and self.model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
        return np.array(self.model.jnt_axis[joint]) if slides else np.zeros(3)

    def _pose_in_link(
        self, body: str
    ) -> tuple[int, Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
        """Link that a body is welded to or slides on, and the body's rotation and position in its frame."""
        rotation = np.eye(3)
        position = np.zeros(3)
        while body not in self._link_names:
            record = self._body(body)
            own = _rotation_matrix(record.quat)
            rotation = own @ rotation
            position = own @ position + record.pos
            body = self.model.body(int(record.parentid[0])).name
        return self._link_names.index(body), rotation, position


def _rotation_matrix(quaternion: Float[np.ndarray, " 4"]) -> Float[np.ndarray, "3 3"]:
    """Rotation matrix of a quaternion w x y z."""
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    # Right angles come out of the compiler as 1e-17; exact zeros keep exact products.
    matrix[np.abs(matrix) < 1e-12] = 0
    return matrix.reshape(3, 3)


_ROBOTS: dict[str, Robot] = {}


def register_robot(robot: Robot) -> Robot:
    """Make a robot known by its name, so that scene files can refer to it; returns the robot."""
    _ROBOTS[robot.name] = robot
    return robot


def robot_named(name: str) -> Robot:
    """Return the registered robot of this name.

    Raises:
        DvrError: There is none; the message lists the names that are known.
    """
    if name not in _ROBOTS:
        raise DvrError(f"there is no robot '{name}'; valid: {', '.join(sorted(_ROBOTS))}.")
    return _ROBOTS[name]
