"""Imports go one way: a package imports only from those above it in the list, and so do the tests of a package.

The imports are read from the syntax trees, so those inside functions count; those under ``if TYPE_CHECKING`` do not.
"""

import ast
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import dvr_jax

PACKAGES = (
    "errors",
    "runtime",
    "geometry",
    "shapes",
    "workcell",
    "logic",
    "goals",
    "scene",
    "motion",
    "checker",
    "execution",
    "modes",
    "operators",
    "nlp",
    "solver",
    "seeds",
    "search",
    "dataset",
    "model",
    "drawing",
    "planning",
    "bench",
    "cli",
)
"""Packages and the one module beside them, from the lowest layer to the highest."""

DATA = {"networks"}
"""Packages that hold files and no code."""

PLANNER = ("modes", "operators", "nlp", "solver", "seeds", "search", "model", "planning")
"""What the independent check shares no code with."""

ROOT = Path(dvr_jax.__file__).parent
TESTS = Path(__file__).parent

SHIMS = {
    "plan.py": "python -m dvr_jax.plan",
    "execute.py": "python -m dvr_jax.execute",
    "export.py": "python -m dvr_jax.export",
    "sample.py": "python -m dvr_jax.sample",
    "sweep.py": "python -m dvr_jax.sweep",
    "train.py": "python -m dvr_jax.train",
    "dataset/__main__.py": "python -m dvr_jax.dataset",
    "bench/__main__.py": "python -m dvr_jax.bench",
}
"""Modules of a few lines that only start a command of `dvr_jax.cli`, with the command."""

LONGEST_SHIM = 16
"""Lines of the longest of them."""

NO_PACKAGE = {"docs", "examples"}
"""Folders of tests that run what is written for users, and may import all of it."""

SUPPORT = "support"
"""Folder of helpers of several folders of tests: a test that imports one imports what the helper does."""

EXCEPTIONS = {
    ("bench/test_command.py", "cli"): "the command of the benchmarks lists their names",
    ("model/test_training_run.py", "cli"): "the command stops and resumes a training",
    ("model/test_training_run.py", "planning"): "the labels of the training come from the solver",
    (
        "planning/test_motion_between_samples.py",
        "bench",
    ): "frozen problems whose paths are known to penetrate",
    (
        "search/test_bounds.py",
        "planning",
    ): "a path counts only if the check accepts its motion, which planning makes",
    ("seeds/test_keyframe_beam.py", "bench"): "frozen problems that are known to be feasible",
}
"""Test file and package of a higher layer that it imports, with the reason."""


def imported_modules(path: Path, package: str = "") -> Iterator[str]:
    """Names of all modules that a file imports, those inside functions included.

    Args:
        path: The file.
        package: Dotted name of the package that the file is in, for relative imports.
    """
    for node in _without_type_checking(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = package.split(".")
                base = ".".join(
                    [*parents[: len(parents) - node.level + 1], *([base] if base else [])]
                )
            # A name may be a module, too.
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)


def _without_type_checking(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes below one, but for the bodies of ``if TYPE_CHECKING``."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and ast.unparse(child.test).endswith("TYPE_CHECKING"):
            children: list[ast.AST] = list(child.orelse)
        else:
            children = [child]
        for each in children:
            yield each
            yield from _without_type_checking(each)


def packages_of(module: str) -> set[str]:
    """The package of this distribution that a module belongs to: none, or one."""
    names = module.split(".")
    if names[0] != "dvr_jax" or len(names) == 1:
        return set()
    # A public name stands for the module that it comes from.
    public = dvr_jax._PUBLIC_NAMES.get(names[1])
    if public is not None and names[1] not in PACKAGES:
        names = public.partition(":")[0].split(".")
    return {names[1]} & {*PACKAGES, *DATA}


def modules() -> list[Path]:
    """All modules of the distribution but its `__init__`, relative to it."""
    return sorted(
        path.relative_to(ROOT) for path in ROOT.rglob("*.py") if path != ROOT / "__init__.py"
    )


def layer(package: str) -> int:
    return PACKAGES.index(package)


def test_every_module_has_its_layer() -> None:
    names = {path.parts[0].removesuffix(".py") for path in modules()}
    shims = {name.removesuffix(".py") for name in SHIMS if "/" not in name}
    assert names == {*PACKAGES, *DATA, *shims}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_imports_only_from_those_above_it(package: str) -> None:
    wrong = []
    for path in modules():
        if path.parts[0].removesuffix(".py") != package or str(path) in SHIMS:
            continue
        dotted = ".".join(["dvr_jax", *path.parts[:-1]])
        for module in imported_modules(ROOT / path, dotted):
            wrong += [
                f"{path} imports {module}"
                for other in packages_of(module)
                if layer(other) > layer(package)
            ]
    assert not wrong, "\n".join(sorted(set(wrong)))


@pytest.mark.parametrize("name", SHIMS)
def test_a_shim_only_starts_its_command(name: str) -> None:
    lines = (ROOT / name).read_text(encoding="utf-8").splitlines()
    assert len(lines) <= LONGEST_SHIM
    assert SHIMS[name] in "\n".join(lines)
    imported = {
        package for module in imported_modules(ROOT / name) for package in packages_of(module)
    }
    # Imported, `dvr_jax.plan` is the function of the public API.
    assert imported <= {"cli", "errors", *(["planning"] if name == "plan.py" else [])}


def test_the_check_loads_nothing_of_the_planner() -> None:
    """Directly or through others, whatever the order of the packages is."""
    code = """
import sys
import dvr_jax.checker.replay
print(*{name.split(".")[1] for name in sys.modules if name.startswith("dvr_jax.")})
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    loaded = set(done.stdout.split())
    assert "checker" in loaded and not loaded & set(PLANNER)


@cache
def _packages_of_test(path: Path) -> frozenset[str]:
    """Packages that a test file imports, directly or through helpers beside it or in the support folder."""
    found: set[str] = set()
    for module in imported_modules(path):
        found |= packages_of(module)
        for folder in (path.parent, TESTS / SUPPORT):
            helper = folder / f"{module}.py"
            if helper.is_file() and helper != path:
                found |= _packages_of_test(helper)
    return frozenset(found)


def _folders() -> list[str]:
    return sorted({path.relative_to(TESTS).parts[0] for path in TESTS.glob("*/*.py")})


def test_every_test_file_has_a_name_of_its_own() -> None:
    """Folders of tests are no packages: pytest could not tell two files of one name apart."""
    names = Counter(path.name for path in TESTS.rglob("test_*.py"))
    assert [name for name, number in names.items() if number > 1] == []


def test_every_folder_of_tests_is_named_after_its_package() -> None:
    assert set(_folders()) <= {*PACKAGES, *NO_PACKAGE, SUPPORT}


@pytest.mark.parametrize("folder", sorted({*_folders()} & {*PACKAGES}))
def test_tests_import_only_from_their_package_and_those_above_it(folder: str) -> None:
    wrong = {
        (str(path.relative_to(TESTS)), package)
        for path in (TESTS / folder).rglob("*.py")
        for package in _packages_of_test(path)
        if package in PACKAGES and layer(package) > layer(folder)
    }
    excepted = {key for key in EXCEPTIONS if key[0].startswith(f"{folder}/")}
    assert wrong <= excepted, sorted(wrong - excepted)
    assert excepted <= wrong, f"needed no more: {sorted(excepted - wrong)}"
