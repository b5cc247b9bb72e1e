"""The search of a plan and the network that guides it: given by the caller, or the shipped one of the search's kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from dvr_jax.errors import OptionError
from dvr_jax.operators import Operator
from dvr_jax.planning.arguments import describe_value
from dvr_jax.scene.types import Scene
from dvr_jax.search.predictor import SequencePredictor
from dvr_jax.search.searches import GUIDED, SEARCHES

UNGUIDED = "mbts"
"""Search that takes the place of a guided one where the shipped network does not fit."""

_MEMBERS = ("kind", "checksum", "size", "unfit_reason", "render", "encode_scene", "predict")
"""Members of `SequencePredictor`."""


def choose_search(
    search: str,
    network: object,
    scene: Scene,
    operators: Sequence[Operator],
    say: Callable[[str], None],
) -> tuple[str, SequencePredictor[Any, Any] | None]:
    """Return the search that a plan runs and the network that guides it.

    Args:
        search: Name of the search.
        network: Network that the caller gave; None means the shipped one.
        scene: Scene that is planned.
        operators: Operators that the plan may consist of.
        say: Takes one line where the shipped network does not fit.

    Returns:
        The name of the search, and the network, or None if the search takes none.

    Raises:
        OptionError: There is no such search, the search takes no network, the value is no network of its kind, or the
            network that the caller gave does not fit the scene.
        NetworkError: No network of this kind is shipped.
    """
    if search not in SEARCHES:
        raise OptionError(f"there is no search {search!r}; valid: {', '.join(SEARCHES)}.")
    if search not in GUIDED:
        if network is not None:
            raise OptionError(
                f"the search {search!r} takes no network; valid with one: {', '.join(GUIDED)}."
            )
        return search, None

    chosen = _shipped_network(search) if network is None else _require_network(network)
    if chosen.kind != search:
        raise OptionError(
            f"the network is of the kind {chosen.kind!r}; the search {search!r} needs its own kind."
        )

    reason = chosen.unfit_reason(scene, operators)
    if reason is None:
        return search, chosen
    if network is not None:
        raise OptionError(
            f"the network does not fit: {reason}; valid is a network that was trained for it."
        )
    say(f"the shipped network does not fit: {reason}; {UNGUIDED} searches in its place")
    return UNGUIDED, None


def _shipped_network(kind: str) -> SequencePredictor[Any, Any]:
    # Imported here, so that searches without a network need not wait for it.
    from dvr_jax.model.predictor import load_network

    return load_network(kind)


def _require_network(value: object) -> SequencePredictor[Any, Any]:
    """Return a value that is a network; refuse a class, an image and everything else."""
    if isinstance(value, type):
        raise OptionError(
            f"the network is the class {value.__name__}; valid is an instance, as its load returns it."
        )

    if not all(hasattr(value, name) for name in _MEMBERS):
        raise OptionError(
            f"the network is {describe_value(value)}; valid is a Predictor, as Predictor.load returns it "
            "(a depth image is given to one by dataclasses.replace(predictor, images=...))."
        )

    return value  # type: ignore[return-value]
