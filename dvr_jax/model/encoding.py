"""From grounded actions to what the network takes: a symbol and a pair of masks for each action.

The paper splits an action into its operator symbol, whose number does not depend on the scene, and the tuple of
objects it operates on. A grasp's symbol holds arm and face, its tuple is (object,); a place's symbol holds arm and
support, its tuple is (object, goal region) or, on the table, (object,): the table covers all that no mask shows, and
the symbol already tells it apart. So a scene of N objects has 12 symbols and 2 N distinct tuples.

Faces are named by where they look in the image at first: east (+x of the world), north, west or south. By its own
name, +x say, a face cannot be recognised: a box turned by 180 degrees looks the same, and so does one turned by 90
degrees with its sides exchanged.
"""

import hashlib
import math
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dvr_jax.errors import DvrError
from dvr_jax.logic import ARMS, FACES, OBJECT_ARGUMENT, Grounding, domain_signature
from dvr_jax.logic.errors import listed
from dvr_jax.scene.types import Scene, SceneObject

Symbol = tuple[str, ...]
"""Operator and the arguments that are no objects, as in `("grasp", "left", "east")`."""

DIRECTIONS = ("east", "north", "west", "south")
"""Where a face may look: +x, +y, -x, -y of the world, within 45 degrees."""

SUPPORTS = ("table", "goal")

SYMBOLS: tuple[Symbol, ...] = (*product(("grasp",), ARMS, DIRECTIONS), *product(("place",), ARMS, SUPPORTS))
"""All symbols; the place of one in this list is its code."""

_MIRRORED = (
    {"left": "right", "right": "left", "east": "west", "west": "east"},
    {"north": "south", "south": "north"},
)
"""Words that change when a scene's x or y is reversed; with x, the arms change places."""

MIRRORED = np.array(
    [
        [
            [SYMBOLS.index(tuple((in_x | in_y).get(word, word) for word in symbol)) for symbol in SYMBOLS]
            for in_y in ({}, _MIRRORED[1])
        ]
        for in_x in ({}, _MIRRORED[0])
    ],
    np.int32,
)
"""Code of each symbol when the scene's x is reversed and when its y is (2, 2, symbols); both are a turn by 180 degrees
about the table's middle."""

_CODE = {symbol: code for code, symbol in enumerate(SYMBOLS)}
_PLACE_ON_GOAL = frozenset(symbol for symbol in SYMBOLS if symbol[0] == "place" and symbol[2] == "goal")


class ActionCodes(NamedTuple):
    """The A grounded actions of a scene of N objects, as arrays."""

    symbol: NDArray[np.int32]
    """Index into SYMBOLS (A,)."""
    normal: NDArray[np.float32]
    """Horizontal outward normal (A, 2) of the face that is grasped, in the world; zero of a place and of a cylinder,
    whose faces are not told apart."""
    tuple_index: NDArray[np.int32]
    """Index into `pairs` (A,)."""
    pairs: NDArray[np.int32]
    """The distinct tuples (2 N, 2), as indices into the stack of masks of `images.SceneImages`: tuple i is object i
    alone, tuple N + i object i and the goal region."""


def object_pairs(number: int) -> NDArray[np.int32]:
    """The distinct tuples of a scene of N objects (2 N, 2): see `ActionCodes.pairs`."""
    objects = np.arange(number)
    alone, on_goal = np.full(number, number + 1), np.full(number, number)
    return np.stack([np.tile(objects, 2), np.concatenate([alone, on_goal])], axis=1).astype(np.int32)


def goal_tuple(scene: Scene) -> int:
    """Index of the goal's own tuple (goal object, goal region) among a scene's `object_pairs`."""
    return len(scene.objects) + scene.goal_index


def encode_actions(grounding: Grounding, objects: Sequence[SceneObject]) -> ActionCodes:
    """Codes of `grounding.actions` over these objects, in the scene's order."""
    symbols, normals, tuples = [], [], []
    index = {item.name: i for i, item in enumerate(objects)}
    for action in grounding.actions:
        place = OBJECT_ARGUMENT.get(action.operator)
        if place is None:
            raise DvrError(f"{action}: the network knows no operator '{action.operator}'; it knows: {_operators()}.")
        name = action.arguments[place]
        if name not in index:
            raise DvrError(f"{action}: '{name}' is no object of the scene; objects: {listed(index)}.")
        words = (*action.arguments[:place], *action.arguments[place + 1 :])
        normals.append(_normal(words[-1], objects[index[name]]))
        if action.operator == "grasp" and words[1] in FACES:
            words = words[0], direction(words[1], objects[index[name]])
        symbol = (action.operator, *words)
        if symbol not in _CODE:
            same = [" ".join(known[1:]) for known in SYMBOLS if known[0] == action.operator]
            raise DvrError(f"{action}: the network knows no {action.operator} {words}; it knows: {listed(same)}.")
        symbols.append(_CODE[symbol])
        tuples.append(index[name] + (len(objects) if symbol in _PLACE_ON_GOAL else 0))
    return ActionCodes(
        np.array(symbols, np.int32),
        np.array(normals, np.float32).reshape(-1, 2),
        np.array(tuples, np.int32),
        object_pairs(len(objects)),
    )


def _normal(word: str, item: SceneObject) -> tuple[float, float]:
    """Horizontal normal of a box's face; zero where the word names none."""
    if word not in FACES or item.shape == "cylinder":
        return 0.0, 0.0
    angle = item.yaw + FACES.index(word) * math.pi / 2
    return math.cos(angle), math.sin(angle)


def direction(face: str, item: SceneObject) -> str:
    """Where a face of an object looks in the scene's initial state; a cylinder's yaw cannot be seen, and is taken for
    0."""
    yaw = 0.0 if item.shape == "cylinder" else item.yaw
    return DIRECTIONS[(FACES.index(face) + round(yaw / (math.pi / 2))) % 4]


def input_signature() -> str:
    """What a network's inputs mean: a hash of the domain and of the list of symbols. A network whose signature differs
    was trained on other actions."""
    return hashlib.sha256(repr((domain_signature(), SYMBOLS)).encode()).hexdigest()[:16]


def _operators() -> str:
    return listed(OBJECT_ARGUMENT)
