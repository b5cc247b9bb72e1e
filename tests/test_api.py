"""The public API: light to import, each name documented, and `dvr_jax.plan` the function whatever is imported."""

import ast
import importlib
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

import dvr_jax

HEAVY = ("jax", "numpy", "mujoco", "scipy", "pyarrow", "flax", "orbax", "PIL", "tyro")


def run(code: str) -> str:
    """What a process of its own prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_the_import_is_light() -> None:
    code = f"""
import sys, time
begin = time.perf_counter()
import dvr_jax
seconds = time.perf_counter() - begin
print(seconds, [name for name in {HEAVY} if name in sys.modules])
"""
    measured = [run(code).split(" ", 1) for _ in range(3)]
    assert {modules for _, modules in measured} == {"[]"}
    assert min(float(seconds) for seconds, _ in measured) < 0.1


def text_below(module: str, name: str) -> str:
    """The text that stands below the definition of a name, in its module or where the module imports it from."""
    body = ast.parse(
        Path(importlib.import_module(module).__file__ or "").read_text(encoding="utf-8")
    ).body
    for statement, after in pairwise([*body, ast.Pass()]):
        if isinstance(statement, ast.ImportFrom) and name in {
            alias.name for alias in statement.names
        }:
            return text_below(statement.module or "", name)
        targets = (
            statement.targets
            if isinstance(statement, ast.Assign)
            else [getattr(statement, "target", None)]
        )
        is_definition = any(
            isinstance(target, ast.Name) and target.id == name for target in targets
        )
        if is_definition and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            return str(after.value.value)
    return ""


def test_each_name_resolves_and_is_documented() -> None:
    for name in dvr_jax.__all__:
        value = getattr(dvr_jax, name)
        module, _, attribute = dvr_jax._PUBLIC_NAMES[name].partition(":")
        # The class of a tuple or a dict is documented, but not the value: that is, below it in its module.
        documentation = value.__doc__ if callable(value) else text_below(module, attribute)
        assert documentation and documentation[0].isupper(), name
        # What a dataclass writes by itself is no documentation.
        assert not documentation.startswith(f"{name}("), name
        assert name in dir(dvr_jax)


def test_type_checkers_see_the_same_names_from_the_same_modules() -> None:
    tree = ast.parse(Path(dvr_jax.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    seen = {}
    for statement in block.body:
        assert isinstance(statement, ast.ImportFrom)
        seen |= {alias.asname: f"{statement.module}:{alias.name}" for alias in statement.names}
    assert seen == dvr_jax._PUBLIC_NAMES


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'dvr_jax' has no attribute 'plans'"):
        _ = dvr_jax.plans
    assert not hasattr(dvr_jax, "words")


@pytest.mark.parametrize(
    "imports",
    [
        "import dvr_jax.plan",
        "import dvr_jax; dvr_jax.plan; import dvr_jax.plan",
        "import dvr_jax; from dvr_jax import plan; import dvr_jax.plan; assert plan is dvr_jax.plan",
        "import dvr_jax.plan; from dvr_jax import plan; assert plan is dvr_jax.plan",
        "import dvr_jax, importlib; assert importlib.import_module('dvr_jax.plan') is dvr_jax.plan",
        "import dvr_jax.sample, dvr_jax.sweep, dvr_jax.train, dvr_jax.cli.plan",
    ],
)
def test_plan_stays_the_function(imports: str) -> None:
    code = f"""
{imports}
import dvr_jax
from dvr_jax.planning import planner
assert dvr_jax.plan is planner.plan
try:
    dvr_jax.plan("scene.json")
except dvr_jax.OptionError as error:
    print(error)
"""
    assert (
        run(code)
        == "the scene is the path 'scene.json'; valid is a Scene, as load_scene('scene.json') returns it."
    )


def test_each_kind_of_error_is_a_dvr_error_that_says_when_it_is_raised() -> None:
    kinds = [getattr(dvr_jax, name) for name in dvr_jax.__all__ if name.endswith("Error")]
    assert len(kinds) == 7
    assert all(issubclass(kind, dvr_jax.DvrError) for kind in kinds)
    assert len({kind.__doc__ for kind in kinds}) == len(kinds)
