"""The README's Python runs as it stands."""

import re
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace

import mujoco
import numpy as np
import pytest

README = Path(__file__).parents[1] / "README.md"


def test_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    *blocks, viewing = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) >= 2 and "launch_passive" in viewing
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec("\n".join(blocks), names)
    said = capsys.readouterr().out
    assert said.startswith("solved\n") and ": feasible\n" in said and ": infeasible by the " in said
    assert (tmp_path / "film.png").stat().st_size > 10_000

    # A viewer without a window, which sees the same states.
    seen: list[np.ndarray] = []

    @contextmanager
    def launch_passive(model: mujoco.MjModel, data: mujoco.MjData):
        yield SimpleNamespace(sync=lambda: seen.append(data.qpos.copy()))

    viewer = ModuleType("mujoco.viewer")
    viewer.launch_passive = launch_passive  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "mujoco.viewer", viewer)
    monkeypatch.setattr(mujoco, "viewer", viewer, raising=False)
    slept: list[float] = []
    monkeypatch.setattr(time, "sleep", slept.append)
    result = names["result"]
    result.save(tmp_path / "out/plan", animation=False)  # type: ignore[attr-defined]
    exec(viewing, {})
    motion = result.motion  # type: ignore[attr-defined]
    np.testing.assert_allclose(seen, motion.qpos, atol=1e-12)
    assert sum(slept) == pytest.approx(motion.time[-1], rel=0.01)
