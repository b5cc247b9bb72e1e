"""The rules of stacks, which hold for all operators of a task in which objects are supports.

An action *switches* an object if it changes where the object is or which arm holds it. Two rules are added to the
preconditions that the operators state themselves:

- An object on which another one stands is not switched.
- An object is put on another one only if nothing stands there, and no arm holds the lower one. No object is put on
  itself.

In PDDL, the first rule is the usual precondition ``(forall (?upper - movable) (not (on ?upper ?item)))`` of every
action on `?item`, and the second one the same for the lower object. They are stated here once, so that a further
operator need not repeat them, and a domain without stacks stays what it is.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from dvr_jax.logic.actions import Action, Fact, Masks
from dvr_jax.logic.grounding import Grounding


def with_stacking_rules(grounding: Grounding, tops: Collection[str]) -> Grounding:
    """Return a grounding whose actions also observe the rules of stacks.

    Args:
        grounding: Actions and facts by the names of the user.
        tops: Names of the objects that are supports.
    """
    if not tops:
        return grounding

    bit_of = {fact: 1 << index for index, fact in enumerate(grounding.facts)}
    actions: list[Action] = []
    masks: list[Masks] = []
    for action, mask in zip(grounding.actions, grounding.masks, strict=True):
        added = grounding.facts_in(mask.added)
        put_on = {(item, lower) for name, item, lower in _on(added) if lower in tops}
        if any(item == lower for item, lower in put_on):
            continue

        changed = (*added, *grounding.facts_in(mask.deleted))
        forbidden = mask.forbidden
        must_be_free = _switched(changed) | {lower for _, lower in put_on}
        for fact, bit in bit_of.items():
            stands_there = fact[0] == "on" and fact[2] in tops and fact[2] in must_be_free
            is_held = fact[0] == "holding" and any(fact[2] == lower for _, lower in put_on)
            if stands_there or is_held:
                forbidden |= bit
        actions.append(action)
        masks.append(replace(mask, forbidden=forbidden))
    return replace(grounding, actions=tuple(actions), masks=tuple(masks))


def _on(facts: Collection[Fact]) -> list[Fact]:
    """Return the facts that an object is on a support."""
    return [fact for fact in facts if fact[0] == "on"]


def _switched(facts: Collection[Fact]) -> set[str]:
    """Return the objects that facts speak of."""
    place = {"on": 1, "holding": 2}
    return {fact[place[fact[0]]] for fact in facts if fact[0] in place}
