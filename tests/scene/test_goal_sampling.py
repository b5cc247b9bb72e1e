"""Random goals of several objects."""

import pytest

from dvr_jax import OptionError, SceneError, load_scenes, sample_scenes, save_scenes
from dvr_jax.geometry.footprint import covers
from dvr_jax.goals import HandsEmpty, On
from dvr_jax.scene.goal_sampling import scene_with_goals
from dvr_jax.scene.mjcf import require_free_home
from dvr_jax.scene.start import goal_holds_at_start


@pytest.mark.parametrize("goals", [2, 4])
def test_sampled_goals_are_valid_scenes(goals: int, tmp_path) -> None:
    scenes = list(sample_scenes(8, objects=4, seed=5, goals=goals))
    plain = list(sample_scenes(8, objects=4, seed=5))
    for scene, base in zip(scenes, plain, strict=True):
        assert scene.objects == base.objects
        named = [fact.object for fact in scene.goal.facts if isinstance(fact, On)]
        assert len(set(named)) == goals and named[0] == base.paper_goal.object
        assert scene.goal.facts[-1] == HandsEmpty()
        assert not goal_holds_at_start(scene)
    save_scenes(tmp_path / "s.jsonl", scenes)
    assert load_scenes(tmp_path / "s.jsonl") == tuple(scenes)
    assert list(sample_scenes(3, objects=4, seed=5, goals=goals)) == scenes[:3]


@pytest.mark.parametrize("goals", [1, 2])
def test_a_raised_region_lies_on_a_bench(goals: int, tmp_path) -> None:
    scenes = list(sample_scenes(8, objects=2, seed=6, goals=goals, raised=True))
    for scene in scenes:
        [bench] = scene.fixed
        place = scene.supports()["plate"]
        assert (place.owner, place.height) == ("bench", bench.top)
        assert 0.03 <= bench.top <= 0.25 and bench.bottom == pytest.approx(0, abs=1e-12)
        assert covers(bench.footprint, place.area)
        require_free_home(scene)
        assert not goal_holds_at_start(scene)
    assert len({scene.fixed[0].top for scene in scenes}) == 8
    save_scenes(tmp_path / "s.jsonl", scenes)
    assert load_scenes(tmp_path / "s.jsonl") == tuple(scenes)


def test_more_goals_than_objects_are_refused() -> None:
    [scene] = sample_scenes(1, objects=2, seed=0)
    with pytest.raises(SceneError, match="3 objects of 2 are wanted"):
        scene_with_goals(scene, 3, (0, 0))
    with pytest.raises(OptionError, match="goals is 3; valid is 1 to the number of objects, 2"):
        next(iter(sample_scenes(1, objects=2, goals=3)))
