"""The targets against the paper's equation, read word for word."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvr_jax.dataset.known_prefixes import KnownPrefixes
from dvr_jax.dataset.sequence_index import sequence_index_of
from dvr_jax.dataset.targets import targets
from dvr_jax.errors import DvrError
from dvr_jax.logic import enumerate_sequences
from dvr_jax.scene.sampling import sample_scenes

SEQUENCES = st.lists(
    st.tuples(st.lists(st.integers(0, 2), min_size=1, max_size=4).map(tuple), st.booleans()),
    max_size=12,
)
"""Few actions and short sequences, so that prefixes are shared and some sequences occur twice."""


@given(SEQUENCES)
def test_equals_the_equation(rows: list[tuple[tuple[int, ...], bool]]) -> None:
    sequences, feasible = [row[0] for row in rows], [row[1] for row in rows]
    expected = [
        [
            float(
                verdict
                or any(other and a_l[:j] == a_i[:j] and len(a_l) >= j for a_l, other in rows)
            )
            for j in steps
        ]
        for a_i, verdict in rows
        for steps in [range(1, len(a_i) + 1)]
    ]
    found = targets(sequences, feasible)
    assert [list(f) for f in found] == expected
    assert all(f.dtype == np.float32 for f in found)


@given(SEQUENCES)
def test_ones_come_first(rows: list[tuple[tuple[int, ...], bool]]) -> None:
    for f in targets([row[0] for row in rows], [row[1] for row in rows]):
        assert np.all(np.diff(f) <= 0)


def test_by_hand() -> None:
    found = targets([(1, 2), (1, 3, 4), (2, 2), (1, 2, 5)], [False, True, False, False])
    assert [list(f) for f in found] == [[1, 0], [1, 1, 1], [0, 0], [1, 0, 0]]


def test_one_verdict_for_each_sequence() -> None:
    with pytest.raises(DvrError, match="2 sequences and 1 verdicts"):
        targets([(1,), (2,)], [True])


INDEX = sequence_index_of(next(sample_scenes(1, 2, 0)))
REACHING = [s for length in (2, 3, 4) for s in enumerate_sequences(INDEX.grounding, length)]


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.sampled_from([0.1, 0.7, 0.95, 1.0]))
def test_what_is_known_of_a_prefix_follows_from_all_sequences_up_to_the_longest_solution(
    seed: int, labeled: float
) -> None:
    generator = np.random.default_rng(seed)
    actions = range(len(INDEX.grounding.actions))
    impossible = {action for action in actions if generator.random() < 0.1}
    duplicates = {action for action in actions if generator.random() < 0.1} - impossible
    proper = sorted(
        {
            sequence[:length]
            for sequence in REACHING
            for length in (1, 2, 3)
            if length < len(sequence)
        }
    )
    refuted = {prefix for prefix in proper if generator.random() < 0.1}
    asked = [s for s in REACHING if not duplicates.intersection(s)]
    possible = [s for s in asked if not impossible.intersection(s)]
    left = [s for s in possible if not any(s[:length] in refuted for length in range(len(s)))]
    good = {s for s in left if len(s) >= 3 and generator.random() < 0.02}
    bad = {s for s in left if s not in good and generator.random() < labeled}
    longest = max(map(len, good), default=0)
    verdicts = KnownPrefixes(INDEX, good, bad, refuted, impossible, duplicates)

    def is_bad(sequence: tuple[int, ...]) -> bool:
        labeled = any(sequence[:length] in refuted | bad for length in range(1, len(sequence) + 1))
        return labeled or bool(impossible.intersection(sequence))

    for sequence in [*good, *bad, *(s for s in asked[::50] if is_bad(s))]:
        expected = []
        for length in range(1, len(sequence) + 1):
            prefix = sequence[:length]
            begun = [s for s in asked if len(s) <= longest and s[:length] == prefix]
            promising = any(s[:length] == prefix for s in good)
            expected.append(promising or is_bad(prefix) or all(map(is_bad, begun)))
        assert verdicts.known_steps(sequence) == expected
