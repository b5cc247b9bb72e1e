"""The number of actions of the sequence that a guided search tries first, found without any bound.

The programs of a plan depend on it, so it is the first guess of `dvr_jax.search.compile_ahead`.
"""

from __future__ import annotations

from collections.abc import Sequence

from dvr_jax.operators import Operator
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.predictor import Encoding, Images, SequencePredictor
from dvr_jax.search.searches import steps_of
from dvr_jax.search.session import SearchSession
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps, run_alone


def likely_length(
    scene: Scene,
    k_max: int,
    network: SequencePredictor[Images, Encoding],
    operators: Sequence[Operator],
) -> int:
    """Return the number of actions of the sequence whose path a guided search will try first if no bound refutes it.

    Args:
        scene: The scene.
        k_max: Largest number of actions.
        network: The network that guides the search.
        operators: The operators that are known.
    """
    tree = SequenceTree(scene, k_max, operators=operators)
    session = _FirstLeaves(tree, accept=lambda *_: False, progress=lambda _: None)
    try:
        run_alone(steps_of(network.kind, session, network))
    except _Found as found:
        return found.length
    return k_max


class _Found(Exception):
    """The first sequences that a search judges are known."""

    def __init__(self, length: int) -> None:
        """Keep the number of actions of the first of them."""
        super().__init__()
        self.length = length


class _FirstLeaves(SearchSession):
    """A search that ends where the first bound of a complete sequence would be computed."""

    def judge_scene(self) -> Steps[bool]:
        """Return True: the relaxation is left out, because it needs compiled programs."""
        yield from ()
        return True

    def judge_prefix_chains(
        self, leaves: list[Node], relax_first: bool = False
    ) -> Steps[list[Node]]:
        """Raise `_Found`."""
        raise _Found(leaves[0].depth)

    def judge_leaves(self, leaves: list[Node]) -> Steps[list[Node]]:
        """Raise `_Found`."""
        raise _Found(leaves[0].depth)
