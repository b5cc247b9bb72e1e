"""dvr_jax plans tasks and motions for two arms: it turns a scene into a motion that an independent check has accepted.

    import dvr_jax as dvr

    scene = dvr.load_scene("data/scenes/figure1.json")
    plan = dvr.plan(scene)
    print(plan.status, *plan.action_descriptions, sep="\\n")
    plan.save("out/plan")

The public API consists of the names in `__all__`. `import dvr_jax` takes milliseconds, because a name is imported from
its module when it is first used, and JAX is imported with the first name that needs it.
"""

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.10.0"

_PUBLIC_NAMES: dict[str, str] = {
    # Scenes
    "load_scene": "dvr_jax.scene.files:load_scene",
    "load_scenes": "dvr_jax.scene.files:load_scenes",
    "save_scene": "dvr_jax.scene.files:save_scene",
    "save_scenes": "dvr_jax.scene.files:save_scenes",
    "sample_scenes": "dvr_jax.scene.random_scenes:sample_scenes",
    "SceneDistribution": "dvr_jax.scene.sampling:SceneDistribution",
    "Scene": "dvr_jax.scene.types:Scene",
    "SceneObject": "dvr_jax.scene.types:SceneObject",
    "FixedBody": "dvr_jax.scene.types:FixedBody",
    "Region": "dvr_jax.goals:Region",
    "Inside": "dvr_jax.goals:Inside",
    # Goals
    "OnRegion": "dvr_jax.goals:OnRegion",
    "Goal": "dvr_jax.goals:Goal",
    "On": "dvr_jax.goals:On",
    "Holding": "dvr_jax.goals:Holding",
    "HandsEmpty": "dvr_jax.goals:HandsEmpty",
    "Clear": "dvr_jax.goals:Clear",
    "register_fact": "dvr_jax.goals:register_fact",
    # Workcells
    "Workcell": "dvr_jax.workcell.workcell:Workcell",
    "Arm": "dvr_jax.workcell.workcell:Arm",
    "Table": "dvr_jax.workcell.workcell:Table",
    "Robot": "dvr_jax.workcell.robot:Robot",
    "WORKCELLS": "dvr_jax.workcell.workcell:WORKCELLS",
    # Operators
    "Operator": "dvr_jax.operators:Operator",
    "OPERATORS": "dvr_jax.operators:OPERATORS",
    # Planning
    "plan": "dvr_jax.planning.planner:plan",
    "plan_scenes": "dvr_jax.planning.many_scenes:plan_scenes",
    "ScenePlan": "dvr_jax.planning.scene_tasks:ScenePlan",
    "Plan": "dvr_jax.planning.result:Plan",
    "PlanStatus": "dvr_jax.search.status:PlanStatus",
    "feasibility": "dvr_jax.planning.feasibility:feasibility",
    "Verdict": "dvr_jax.planning.feasibility:Verdict",
    "Reason": "dvr_jax.search.reasons:Reason",
    "ReasonKind": "dvr_jax.search.reasons:ReasonKind",
    "Refutation": "dvr_jax.search.explanation:Refutation",
    "Action": "dvr_jax.logic:Action",
    "Predictor": "dvr_jax.model.predictor:Predictor",
    # Motions and their check
    "Motion": "dvr_jax.motion.motion:Motion",
    "check": "dvr_jax.planning.check:check",
    "CheckReport": "dvr_jax.checker:CheckReport",
    # Errors
    "DvrError": "dvr_jax.errors:DvrError",
    "SceneError": "dvr_jax.errors:SceneError",
    "LogicError": "dvr_jax.logic:LogicError",
    "NetworkError": "dvr_jax.errors:NetworkError",
    "MotionError": "dvr_jax.errors:MotionError",
    "DataError": "dvr_jax.errors:DataError",
    "OptionError": "dvr_jax.errors:OptionError",
}
"""Maps each public name to "module:name", the place that it is imported from."""

__all__ = sorted(_PUBLIC_NAMES)

if TYPE_CHECKING:
    # Type checkers and editors cannot read the table above, so the names are repeated here; a test compares the two.
    from dvr_jax.checker import CheckReport as CheckReport
    from dvr_jax.errors import DataError as DataError
    from dvr_jax.errors import DvrError as DvrError
    from dvr_jax.errors import MotionError as MotionError
    from dvr_jax.errors import NetworkError as NetworkError
    from dvr_jax.errors import OptionError as OptionError
    from dvr_jax.errors import SceneError as SceneError
    from dvr_jax.goals import Clear as Clear
    from dvr_jax.goals import Goal as Goal
    from dvr_jax.goals import HandsEmpty as HandsEmpty
    from dvr_jax.goals import Holding as Holding
    from dvr_jax.goals import Inside as Inside
    from dvr_jax.goals import On as On
    from dvr_jax.goals import OnRegion as OnRegion
    from dvr_jax.goals import Region as Region
    from dvr_jax.goals import register_fact as register_fact
    from dvr_jax.logic import Action as Action
    from dvr_jax.logic import LogicError as LogicError
    from dvr_jax.model.predictor import Predictor as Predictor
    from dvr_jax.motion.motion import Motion as Motion
    from dvr_jax.operators import OPERATORS as OPERATORS
    from dvr_jax.operators import Operator as Operator
    from dvr_jax.planning.check import check as check
    from dvr_jax.planning.feasibility import Verdict as Verdict
    from dvr_jax.planning.feasibility import feasibility as feasibility
    from dvr_jax.planning.many_scenes import plan_scenes as plan_scenes
    from dvr_jax.planning.planner import plan as plan
    from dvr_jax.planning.result import Plan as Plan
    from dvr_jax.planning.scene_tasks import ScenePlan as ScenePlan
    from dvr_jax.scene.files import load_scene as load_scene
    from dvr_jax.scene.files import load_scenes as load_scenes
    from dvr_jax.scene.files import save_scene as save_scene
    from dvr_jax.scene.files import save_scenes as save_scenes
    from dvr_jax.scene.random_scenes import sample_scenes as sample_scenes
    from dvr_jax.scene.sampling import SceneDistribution as SceneDistribution
    from dvr_jax.scene.types import FixedBody as FixedBody
    from dvr_jax.scene.types import Scene as Scene
    from dvr_jax.scene.types import SceneObject as SceneObject
    from dvr_jax.search.explanation import Refutation as Refutation
    from dvr_jax.search.reasons import Reason as Reason
    from dvr_jax.search.reasons import ReasonKind as ReasonKind
    from dvr_jax.search.status import PlanStatus as PlanStatus
    from dvr_jax.workcell.robot import Robot as Robot
    from dvr_jax.workcell.workcell import WORKCELLS as WORKCELLS
    from dvr_jax.workcell.workcell import Arm as Arm
    from dvr_jax.workcell.workcell import Table as Table
    from dvr_jax.workcell.workcell import Workcell as Workcell


def __getattr__(name: str) -> object:
    """Import a public name when it is first used (PEP 562)."""
    if name not in _PUBLIC_NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    module, _, attribute = _PUBLIC_NAMES[name].partition(":")
    value: object = getattr(import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names, for editors and interactive sessions."""
    return sorted({*globals(), *_PUBLIC_NAMES})
