"""Encode each action of a scene for the network as a symbol, the normal of the grasped face, and a pair of masks.

A *grounded* action is an operator with arguments from the scene. As in the paper, it is split into a *symbol* and the
*tuple* of objects that it involves. The set of symbols is the same for every scene. The tuple is shown to the network
as images (`dvr_jax.model.images`): a *mask* marks the pixels of one object or of the goal region.

- The symbol of a grasp contains arm and face; its tuple is (object,).
- The symbol of a place contains arm and support. Its tuple is (object, goal region) for a place on the goal, and
  (object,) for a place on the table. The table needs no mask, because the symbol names it.

A scene of N objects has `actions_per_object()` N actions and `tuples_per_object()` N distinct tuples.

A symbol names a face by the direction of its outward normal in the initial scene: east (+x of the world), north, west
or south. The name in the object's own frame, such as +x, is not visible in an image: a box that is turned by 180
degrees looks the same, and so does a box that is turned by 90 degrees with its sides exchanged.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from dvr_jax.errors import DvrError
from dvr_jax.goals import GOAL_REGION, TABLE
from dvr_jax.logic import Action, Grounding, domain_signature
from dvr_jax.logic.errors import listed
from dvr_jax.operators import OPERATORS, Operator, Parameter
from dvr_jax.scene.start import objects_as_supports
from dvr_jax.scene.types import Scene, SceneObject
from dvr_jax.shapes import FACES
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL, Workcell

Symbol = tuple[str, ...]
"""Name of an operator and those of its arguments that are not objects, such as `("grasp", "left", "east")`."""

TRAINED_WORKCELL = DEFAULT_WORKCELL
"""The workcell in which the networks are trained."""

TRAINED_ARMS = TRAINED_WORKCELL.arm_names
"""Names of the two arms with which the networks are trained; a scene's mirror image in x exchanges them."""

DIRECTIONS = ("east", "north", "west", "south")
"""Names of the directions of a face's normal: +x, +y, -x, -y of the world, each within 45 degrees."""

SUPPORTS = (TABLE, GOAL_REGION)
"""Supports that the networks know."""

_WORDS = {Parameter.ARM: TRAINED_ARMS, Parameter.FACE: DIRECTIONS, Parameter.SUPPORT: SUPPORTS}
"""Possible words for each type of argument that is not an object."""


def _symbols_of(operator: Operator) -> Iterator[Symbol]:
    """Yield all symbols of an operator."""
    words = [
        _WORDS[parameter] for parameter in operator.parameters if parameter is not Parameter.OBJECT
    ]
    yield from product((operator.name,), *words)


SYMBOLS: tuple[Symbol, ...] = tuple(
    symbol for operator in OPERATORS for symbol in _symbols_of(operator)
)
"""All symbols; the index of a symbol in this list is its code."""

_CODES = {symbol: code for code, symbol in enumerate(SYMBOLS)}
"""Code of each symbol."""

_PLACES_ON_GOAL = frozenset(symbol for symbol in SYMBOLS if symbol[-1] == GOAL_REGION)
"""Symbols of actions that place an object on the goal region; their last word is the support."""

_REVERSED_IN_X = {
    **dict(zip(TRAINED_ARMS, reversed(TRAINED_ARMS), strict=True)),
    "east": "west",
    "west": "east",
}
"""Words of a symbol that change when the x of a scene is reversed."""

_REVERSED_IN_Y = {"north": "south", "south": "north"}
"""Words of a symbol that change when the y of a scene is reversed."""


def actions_per_object() -> int:
    """Return the number of actions of a scene divided by its number of objects.

    Every symbol occurs exactly once with every object, so this is the number of symbols.
    """
    return len(SYMBOLS)


def tuples_per_object() -> int:
    """Return the number of distinct tuples of a scene divided by its number of objects.

    An object occurs in a tuple alone or together with the goal region, depending on the symbol.
    """
    return len({symbol in _PLACES_ON_GOAL for symbol in SYMBOLS})


def _mirrored_codes() -> Int[np.ndarray, "2 2 symbols"]:
    """Return the code of each symbol in each of the four mirrored scenes, the table `MIRRORED`."""
    codes = np.empty((2, 2, len(SYMBOLS)), np.int32)
    for in_x, in_y in product((0, 1), repeat=2):
        words = (_REVERSED_IN_X if in_x else {}) | (_REVERSED_IN_Y if in_y else {})
        for code, symbol in enumerate(SYMBOLS):
            mirrored = tuple(words.get(word, word) for word in symbol)
            codes[in_x, in_y, code] = _CODES[mirrored]
    return codes


MIRRORED = _mirrored_codes()
"""Code of each symbol in a mirrored scene (2, 2, symbols).

The first index is 1 if the scene's x is reversed, the second is 1 if its y is reversed. Both together turn the scene by
180 degrees about the middle of the table.
"""


class ActionCodes(NamedTuple):
    """The grounded actions of a scene of N objects as arrays."""

    symbol: Int[np.ndarray, " actions"]
    """Code of each action's symbol, an index into `SYMBOLS`."""

    normal: Float[np.ndarray, "actions 2"]
    """Horizontal outward normal of the grasped face in the world.

    It is zero for a place, and for a grasp of a cylinder, whose faces cannot be told apart.
    """

    tuple_index: Int[np.ndarray, " actions"]
    """Each action's tuple, an index into `pairs`."""

    pairs: Int[np.ndarray, "tuples 2"]
    """The two masks of each distinct tuple, as `object_pairs` gives them."""


def object_pairs(number: int) -> Int[np.ndarray, "tuples 2"]:
    """Return the indices of the two masks of each distinct tuple of a scene of N objects.

    Tuple i is object i alone, and tuple N + i is object i with the goal region. The indices refer to the masks of
    `dvr_jax.model.images.SceneImages`: the N objects, the goal region (index N) and a mask of zeros (index N + 1).
    """
    objects = np.arange(number)
    no_second_object = np.full(number, number + 1)
    goal_region = np.full(number, number)

    first_mask = np.tile(objects, tuples_per_object())
    second_mask = np.concatenate([no_second_object, goal_region])
    return np.stack([first_mask, second_mask], axis=1).astype(np.int32)


def goal_tuple(scene: Scene) -> int:
    """Return the index of the goal's own tuple (goal object, goal region) among the scene's `object_pairs`."""
    return len(scene.objects) + scene.goal_index


def encode_actions(grounding: Grounding, objects: Sequence[SceneObject]) -> ActionCodes:
    """Encode all actions of a grounding.

    Args:
        grounding: The grounded actions.
        objects: The objects that the actions operate on, in the scene's order.

    Returns:
        The codes, in the order of `grounding.actions`.

    Raises:
        DvrError: An action has an operator, an argument or an object that the network does not know.
    """
    object_index = {item.name: index for index, item in enumerate(objects)}
    symbols: list[int] = []
    normals: list[tuple[float, float]] = []
    tuples: list[int] = []

    for action in grounding.actions:
        index, words = _split(action, object_index)
        item = objects[index]
        symbol = _symbol(action, words, item)
        symbols.append(_CODES[symbol])
        normals.append(_face_normal(words[-1], item))
        tuples.append(index + (len(objects) if symbol in _PLACES_ON_GOAL else 0))

    return ActionCodes(
        symbol=np.array(symbols, np.int32),
        normal=np.array(normals, np.float32).reshape(-1, 2),
        tuple_index=np.array(tuples, np.int32),
        pairs=object_pairs(len(objects)),
    )


def _split(action: Action, object_index: Mapping[str, int]) -> tuple[int, tuple[str, ...]]:
    """Return the index of an action's object and the action's other arguments."""
    known = {operator.name: operator for operator in OPERATORS}
    if action.operator not in known:
        raise DvrError(
            f"{action}: the network knows no operator '{action.operator}'; it knows: {listed(known)}."
        )
    place = known[action.operator].parameters.index(Parameter.OBJECT)

    name = action.arguments[place]
    if name not in object_index:
        raise DvrError(
            f"{action}: '{name}' is no object of the scene; objects: {listed(object_index)}."
        )

    words = (*action.arguments[:place], *action.arguments[place + 1 :])
    return object_index[name], words


def _symbol(action: Action, words: tuple[str, ...], item: SceneObject) -> Symbol:
    """Return the symbol of an action with these other arguments on this object."""
    words = tuple(direction(word, item) if word in FACES else word for word in words)
    symbol = (action.operator, *words)
    if symbol not in _CODES:
        same = [" ".join(known[1:]) for known in SYMBOLS if known[0] == action.operator]
        raise DvrError(
            f"{action}: the network knows no {action.operator} {words}; it knows: {listed(same)}."
        )
    return symbol


def _face_normal(word: str, item: SceneObject) -> tuple[float, float]:
    """Return the horizontal outward normal of a box's face, and zero if the word is no face or the object no box."""
    if word not in FACES or not item.kind.has_faces:
        return 0.0, 0.0
    angle = item.yaw + FACES.index(word) * math.pi / 2
    return math.cos(angle), math.sin(angle)


def direction(face: str, item: SceneObject) -> str:
    """Return the direction of a face's outward normal in the initial scene.

    Args:
        face: One of `FACES`.
        item: The object. The yaw of a cylinder cannot be seen and is taken to be 0.

    Returns:
        One of `DIRECTIONS`.
    """
    yaw = item.yaw if item.kind.has_faces else 0.0
    quarter_turns = round(yaw / (math.pi / 2))
    return DIRECTIONS[(FACES.index(face) + quarter_turns) % len(DIRECTIONS)]


def input_signature() -> str:
    """Return a hash of the symbolic domain and of the list of symbols, which define what the network's inputs mean.

    A network with another signature was trained on other actions.
    """
    meaning = repr((domain_signature(), SYMBOLS))
    return hashlib.sha256(meaning.encode()).hexdigest()[:16]


def unfit_reason(scene: Scene, operators: Sequence[Operator]) -> str | None:
    """Return why networks that use this encoding cannot guide a search, or None if they can.

    Args:
        scene: The scene.
        operators: Operators that the plan may consist of.

    Returns:
        The reason in words; None if they can.
    """
    if _placement(scene.workcell) != _placement(TRAINED_WORKCELL):
        return "it was trained in the usual workcell of two arms that face each other, and this scene has another one"
    unknown = [operator.name for operator in operators if operator not in OPERATORS]
    if unknown:
        return f"it does not know the operator {listed(unknown)}"
    if objects_as_supports(scene):
        return "it does not know objects that stand on each other"
    return None


def _placement(workcell: Workcell) -> object:
    """Return everything that defines a workcell except its home postures, for comparison."""
    arms = tuple((arm.name, arm.position, arm.yaw) for arm in workcell.arms)
    return workcell.robot.name, workcell.table, arms
