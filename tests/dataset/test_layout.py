"""The parts of the layout: compact actions, compact verdicts and scene texts give back what was put in."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvr_jax.dataset.columns import Columns, columns_of, labels_in
from dvr_jax.dataset.compact_actions import compact_actions, expand_actions
from dvr_jax.dataset.compact_verdicts import Verdicts, compact_verdicts, expand_verdicts
from dvr_jax.dataset.labels import BOUNDS, Label, same_label, sort_labels
from dvr_jax.dataset.layout import SCHEMA, from_table, to_table
from dvr_jax.dataset.scene_text import SceneText
from dvr_jax.scene.files import scene_to_json
from dvr_jax.scene.sampling import sample_scenes

NAMES = ("grasp(left, +x, a)", "grasp(left, -x, a)", "place(left, a, goal)", "Ä", "", "z")
SEQUENCES = st.lists(st.sampled_from(NAMES), max_size=4).map(tuple)
VIOLATIONS = st.sampled_from([np.nan, 0.0, 0.5, 7.0, np.inf])
FIRST_SCENE = 3


@st.composite
def label_lists(draw: st.DrawFn) -> list[Label]:
    """Labels of four scenes at most; some scenes have none."""
    found = []
    for scene in range(FIRST_SCENE, FIRST_SCENE + draw(st.integers(1, 4))):
        for actions in draw(st.sets(SEQUENCES, max_size=12)):
            bound = draw(st.sampled_from(("", *BOUNDS)))
            prefix = bound != "" and draw(st.booleans())
            found.append(Label(scene, actions, bound == "", prefix, bound, draw(VIOLATIONS)))
    return sort_labels(found)


def as_columns(labels: list[Label]) -> Columns:
    texts = ['{"a": 1.5}', '{"a": -2.25e-07, "b": [0.1]}', "{}", '{"#": 1.5}']
    return columns_of(texts, labels, FIRST_SCENE)


@given(label_lists())
def test_the_table_gives_back_all_labels(labels: list[Label]) -> None:
    columns = as_columns(labels)
    table = to_table(columns, FIRST_SCENE)
    again = from_table(table)
    assert table.schema.equals(SCHEMA)
    assert table["scene"].to_pylist() == [3, 4, 5, 6]
    assert again.scene_texts == columns.scene_texts
    assert np.array_equal(again.label_ends, columns.label_ends)
    assert all(map(same_label, labels_in(again, FIRST_SCENE), labels))
    assert len(labels_in(again, FIRST_SCENE)) == len(labels)


@given(label_lists())
def test_compact_actions_by_their_definition(labels: list[Label]) -> None:
    columns = as_columns(labels)
    compact, order = compact_actions(columns)
    kept = iter(compact.action.tolist())
    before: tuple[int | None, tuple[str, ...]] = (None, ())
    for place, length, shared in zip(
        order.tolist(), compact.length.tolist(), compact.shared.tolist(), strict=True
    ):
        label = labels[place]
        names = compact.names[label.scene - FIRST_SCENE]
        assert names == sorted(set(names))
        expected = 0
        if before[0] == label.scene:
            pairs = zip(label.actions[::-1], before[1][::-1], strict=False)
            expected = next(
                (i for i, (own, other) in enumerate(pairs) if own != other),
                min(length, len(before[1])),
            )
        assert (length, shared) == (len(label.actions), expected)
        assert [names[next(kept)] for _ in range(length - shared)] == list(
            label.actions[::-1][shared:]
        )
        before = (label.scene, label.actions)
    assert next(kept, None) is None

    expanded = expand_actions(compact)
    assert np.array_equal(order[expanded.order], np.arange(len(labels)))


@given(label_lists())
def test_each_distinct_verdict_of_a_scene_is_written_once(labels: list[Label]) -> None:
    columns = as_columns(labels)
    verdicts = Verdicts(columns.refuted_prefix, columns.bound, columns.violation)
    compact = compact_verdicts(verdicts, columns.label_ends)
    again = expand_verdicts(compact, columns.label_ends)
    assert again.bound == verdicts.bound
    assert np.array_equal(again.refuted_prefix, verdicts.refuted_prefix)
    assert np.array_equal(again.violation, verdicts.violation, equal_nan=True)
    distinct = {
        (label.scene, label.refuted_prefix, label.bound, repr(label.violation)) for label in labels
    }
    assert len(compact.distinct.bound) == compact.ends[-1] == len(distinct)


@pytest.mark.parametrize("objects", [1, 2, 5])
def test_scene_texts_keep_every_digit(objects: int) -> None:
    for scene in sample_scenes(20, objects, seed=5):
        text = scene_to_json(scene)
        apart = SceneText.take_apart(text)
        assert apart.put_together() == text
        assert len(apart.numbers) > 5 * objects
        assert not any(character in apart.template for character in "23456789")


@given(st.text(alphabet='{}[]"#:,-.e015 a', max_size=40))
def test_any_text_is_kept(text: str) -> None:
    assert SceneText.take_apart(text).put_together() == text


@pytest.mark.parametrize(
    "text", ['{"name":"a#b","x":1.5}', '{"name":"1.50"}', '{"x":1.5e400}', "#", "1.5#"]
)
def test_texts_that_cannot_be_taken_apart_stay_whole(text: str) -> None:
    assert SceneText.take_apart(text) == SceneText(text, ())
