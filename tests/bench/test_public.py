"""The scenes of public benchmarks, and the table of their results."""

from collections import Counter

import pytest

from dvr_jax.bench.public import PublicOptions, describe, problems_of, solve_problems
from dvr_jax.bench.public_problems import (
    FAMILIES,
    PUBLIC_SCENES,
    draw_all,
    read_public_scenes,
)
from dvr_jax.errors import DvrError
from dvr_jax.geometry.footprint import signed_distance

ALL_NAMES = [family.name for family in FAMILIES]


def test_drawing_again_gives_the_frozen_scenes() -> None:
    assert draw_all() == PUBLIC_SCENES.read_text(encoding="utf-8")


def test_every_family_has_its_number_of_scenes() -> None:
    counted = Counter(name for name, _ in read_public_scenes(ALL_NAMES))
    assert counted == {family.name: family.number for family in FAMILIES}


def test_scenes_of_the_transfer_are_within_the_public_ranges() -> None:
    scenes = [scene for _, scene in read_public_scenes(["transfer"])]
    for scene in scenes:
        (cube,) = scene.objects
        (patch,) = scene.regions
        assert cube.size == (0.06, 0.06, 0.06)
        assert patch.size == (0.2, 0.2)
        gap = (cube.position[0] - patch.position[0], cube.position[1] - patch.position[1])
        assert (gap[0] ** 2 + gap[1] ** 2) ** 0.5 >= 0.25
        for x, y in (cube.position, patch.position):
            assert abs(x) <= 0.7
            assert 0.29 <= y <= 0.64


def test_most_obstructions_stand_on_the_region() -> None:
    on_region = []
    for number, (_, scene) in enumerate(read_public_scenes(["occupied"])):
        assert len(scene.objects) == 1 + number % 5
        (region,) = scene.regions
        gaps = [signed_distance(item.footprint, region.footprint) for item in scene.objects]
        assert gaps[0] > 0
        on_region += [gap < 0 for gap in gaps[1:]]
    assert sum(on_region) > 0.8 * len(on_region)


def test_blocks_of_the_plate_keep_their_distance() -> None:
    for _, scene in read_public_scenes(["plate"]):
        (plate,) = scene.regions
        bodies = [plate.footprint, *(item.footprint for item in scene.objects)]
        gaps = [signed_distance(a, b) for i, a in enumerate(bodies) for b in bodies[:i]]
        assert len(gaps) == 15
        assert min(gaps) >= 0.05


def test_an_unknown_family_or_search_is_refused() -> None:
    with pytest.raises(DvrError, match="there is no family 'towers of pisa'; valid: transfer"):
        problems_of(PublicOptions(families=("towers of pisa",)))
    with pytest.raises(DvrError, match="there is no search 'astar'"):
        next(solve_problems(PublicOptions(searches=("astar",))))


def test_the_table_counts_what_is_solved_and_what_succeeds() -> None:
    row = {"family": "plate", "search": "dvr", "seconds": 2.0, "length": 10, "passed": True}
    rows = [
        {**row, "problem": 0, "succeeded": True},
        {**row, "problem": 1, "seconds": 4.0, "succeeded": False, "cause": "slipped"},
        {**row, "problem": 2, "seconds": 60.0, "length": 0, "passed": False},
    ]
    lines = describe(rows)
    assert (
        "solved 2 of 3, physics 1 of 2, median 4.00 s, at most 60.00 s, actions: 2 x 10" in lines[1]
    )
    assert lines[2] == "physics: 1 of 2 plans succeed (50%)"
    assert lines[3] == "  1 failed: slipped"


@pytest.mark.slow
def test_one_scene_is_planned_and_executed() -> None:
    """Two bars go onto a tray, which is a raised support, from one side of two arms to the other."""
    options = PublicOptions(families=("tray",), searches=("mbts",), time_limit=300.0)
    (row,) = solve_problems(options)
    assert row["passed"]
    assert row["length"] >= 4
    assert row["succeeded"]
