"""Damaged input: a bounded run of the benchmark `fuzz`, and what its judge takes for a problem."""

import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvr_jax.bench import fuzz, fuzz_judge
from dvr_jax.bench.fuzz_commands import fuzz_commands
from dvr_jax.bench.fuzz_damage import damage, damage_json, to_text
from dvr_jax.bench.fuzz_files import fuzz_files, make_files
from dvr_jax.bench.fuzz_judge import Tally, judge
from dvr_jax.bench.fuzz_scenes import fuzz_scenes
from dvr_jax.errors import DvrError, SceneError
from dvr_jax.scene.files import scene_from_json, scene_to_json


def test_damaged_scenes() -> None:
    tally = Tally()
    assert fuzz_scenes(range(600), 1, tally) == []
    assert tally.refused > 400 and tally.accepted > 10


def test_damaged_files(tmp_path: Path) -> None:
    tallies: dict[str, Tally] = {}
    assert fuzz_files(160, 1, tmp_path, tallies) == []
    assert len(tallies) == 8 and all(
        tally.refused + tally.accepted == 20 for tally in tallies.values()
    )


def test_intact_files_read_as_they_are(tmp_path: Path) -> None:
    for kind in make_files(tmp_path):
        assert kind.equal(kind.read(), kind.read())


@pytest.mark.slow
def test_command_lines(tmp_path: Path) -> None:
    tally = Tally()
    assert fuzz_commands(40, 1, tmp_path, tally) == []
    assert tally.refused > 20


def test_the_command_counts_and_has_an_exit_code(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    options = ["--number", "20", "--files", "16", "--commands", "0"]
    assert fuzz.run(options) == 0
    assert "0 of 36 cases ended as none may" in capsys.readouterr().out
    monkeypatch.setattr("dvr_jax.bench.fuzz_scenes.scene_from_json", lambda text: [][len(text)])
    assert fuzz.run(options) == 1
    assert "scene 0: IndexError in " in capsys.readouterr().out


def refuse(message: str) -> str | None:
    raise DvrError(message)


def test_what_the_judge_takes_for_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzz_judge, "LONGEST_CASE", 1)
    assert judge(lambda: None, "a.json", Tally()) is None
    assert judge(lambda: refuse("a.json is broken."), "a.json", Tally()) is None
    assert judge(lambda: refuse("broken."), "a.json", Tally()) is not None
    assert judge(lambda: "it differs", None, Tally()) == "it differs"
    assert judge(lambda: str(1 // 0), None, Tally()) is not None
    assert judge(lambda: str(time.sleep(5)), None, Tally()) == "it takes more than 1 s"


@given(st.binary(max_size=300), st.integers(0, 2**32))
@settings(max_examples=50, deadline=None)
def test_any_bytes_can_be_damaged(content: bytes, seed: int) -> None:
    assert damage(content, np.random.default_rng(seed)) == damage(
        content, np.random.default_rng(seed)
    )


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(),
    lambda child: st.lists(child, max_size=3) | st.dictionaries(st.text(), child, max_size=3),
    max_leaves=12,
)
"""Any JSON value, and NaN, infinities and lone surrogates beside."""


@given(st.dictionaries(st.text(), JSON, min_size=1, max_size=4), st.integers(0, 2**32))
@settings(max_examples=50, deadline=None)
def test_any_json_can_be_damaged(record: dict[str, object], seed: int) -> None:
    to_text(damage_json(record, np.random.default_rng(seed)))


@given(JSON)
@settings(max_examples=150, deadline=None)
def test_any_json_is_a_scene_or_refused_in_one_sentence(record: object) -> None:
    try:
        scene = scene_from_json(to_text(record))
    except SceneError as error:
        assert str(error).startswith("scene: ") and str(error).isprintable()
    else:
        assert scene_from_json(scene_to_json(scene)) == scene
