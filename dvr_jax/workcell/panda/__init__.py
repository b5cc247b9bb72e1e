"""The Franka Panda with its hand: its MuJoCo model, which holds every constant, and its closed-form kinematics."""

from importlib.resources import files
from typing import Any

from dvr_jax.workcell.robot import InverseKinematics, Robot, register_robot


def _solve(*arguments: Any) -> Any:
    """Closed-form inverse kinematics; JAX is imported when it is first called."""
    from dvr_jax.workcell.panda.inverse_kinematics import arm_angles

    return arm_angles(*arguments)


PANDA = register_robot(
    Robot(
        name="panda",
        mjcf=(files("dvr_jax.workcell.panda") / "panda.xml").read_text(encoding="utf-8"),
        inverse_kinematics=InverseKinematics(_solve, branches=4, free_joints=(6,)),
    )
)
"""The robot of the paper's experiments."""
