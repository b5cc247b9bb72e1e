"""Plans whose motions are made by hand: one that succeeds in physics, and one whose closed fingers push the object."""

from puppet import Case

from dvr_jax.checker.replay import check_motion
from dvr_jax.motion.motion import Motion
from dvr_jax.planning.result import Plan
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.search.status import PlanStatus


def with_closed_fingers(case: Case) -> Motion:
    """The motion of a case with fingers that are closed up to the grasp."""
    qpos = case.motion.qpos.copy()
    qpos[: case.motion.switch[0], qpos_layout(case.scene).fingers[0]] = 0.0
    return Motion(case.motion.time, qpos, case.motion.switch)


def plan_of(case: Case, motion: Motion | None) -> Plan:
    """A plan with this motion and with the check's report on the case's own motion; unsolved without a motion."""
    return Plan(
        scene=case.scene,
        status=PlanStatus.SOLVED if motion else PlanStatus.EXHAUSTED,
        actions=case.actions if motion else (),
        motion=motion,
        report=check_motion(case.scene, case.actions, case.motion) if motion else None,
        path=None,
        violations={},
        seconds={},
        nlps={},
        verdicts={},
        rejected=0,
    )
