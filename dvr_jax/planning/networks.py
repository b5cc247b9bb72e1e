"""The network of a plan: given by the caller, or the shipped one of the search's kind."""

from __future__ import annotations

from typing import Protocol

from dvr_jax.errors import OptionError
from dvr_jax.planning.arguments import describe_value
from dvr_jax.search.reasoning import Network
from dvr_jax.search.searches import GUIDED, SEARCHES


class TrainedNetwork(Network, Protocol):
    """What a plan needs of a network, such as a `Predictor`: what the search needs, its kind and its checksum."""

    @property
    def kind(self) -> str:
        """Name of the search that the network guides."""
        ...

    @property
    def checksum(self) -> str:
        """Hash of the weights, by which a plan names its network."""
        ...


_MEMBERS = ("kind", "checksum", "size", "look", "begin", "step")
"""Members of `TrainedNetwork`."""


def choose_network(search: str, network: object) -> TrainedNetwork | None:
    """Return the network that guides a search.

    Args:
        search: Name of the search.
        network: Network that the caller gave; None means the shipped one.

    Returns:
        The network, or None if the search takes none.

    Raises:
        OptionError: There is no such search, the search takes no network, or the value is no network of its kind.
        DvrError: No network of this kind is shipped.
    """
    if search not in SEARCHES:
        raise OptionError(f"there is no search {search!r}; valid: {', '.join(SEARCHES)}.")

    if search not in GUIDED:
        if network is not None:
            raise OptionError(f"the search {search!r} takes no network; valid with one: {', '.join(GUIDED)}.")
        return None

    if network is None:
        # Imported here, so that searches without a network need not wait for it.
        from dvr_jax.model.predictor import load_network

        return load_network(search)

    trained = _require_network(network)
    if trained.kind != search:
        raise OptionError(f"the network is of the kind {trained.kind!r}; the search {search!r} needs its own kind.")

    return trained


def _require_network(value: object) -> TrainedNetwork:
    """Return a value that is a network; refuse a class, an image and everything else."""
    if isinstance(value, type):
        raise OptionError(f"the network is the class {value.__name__}; valid is an instance, as its load returns it.")

    if not all(hasattr(value, name) for name in _MEMBERS):
        raise OptionError(
            f"the network is {describe_value(value)}; valid is a Predictor, as Predictor.load returns it "
            "(a depth image is given to one by dataclasses.replace(predictor, images=...))."
        )

    return value  # type: ignore[return-value]
