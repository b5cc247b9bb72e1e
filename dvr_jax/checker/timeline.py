"""The walk through the actions of a plan: which object is attached to what, from which switch to which."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from dvr_jax.checker.operators.operator import (
    AttachmentInterval,
    OperatorCheck,
    Standing,
    Timeline,
)
from dvr_jax.checker.operators.parameter import Arguments, Parameter
from dvr_jax.checker.operators.start import START_CHECK
from dvr_jax.checker.stacks import Stacks
from dvr_jax.errors import MotionError
from dvr_jax.logic import Action
from dvr_jax.motion.motion import Motion
from dvr_jax.scene.types import Scene


def attachment_timeline(
    scene: Scene,
    actions: Sequence[Action],
    motion: Motion,
    operators: Sequence[OperatorCheck],
) -> Timeline:
    """Divide a motion into the intervals in which objects keep their attachments.

    Args:
        scene: The scene that the motion starts in.
        actions: The actions, as many as the motion has switches.
        motion: The motion.
        operators: Operators that actions may be of.

    Returns:
        The intervals of all objects over all samples, without gaps.

    Raises:
        MotionError: An action has an unknown operator or argument, or does not apply where it stands.
    """
    samples = len(motion.time)
    closed: list[AttachmentInterval] = []
    current = {
        index: AttachmentInterval(index, 0, samples, Standing(), START_CHECK, {})
        for index in range(len(scene.objects))
    }

    stacks = Stacks.at_start(scene)

    for number, (action, switch) in enumerate(
        zip(actions, motion.switch.tolist(), strict=True), start=1
    ):
        operator, arguments = _read_action(scene, action, operators, number)
        refusal = operator.refusal(arguments, _held_objects(scene, current.values()))
        if refusal:
            raise MotionError(f"action {number}, {action}: {refusal}")

        refusal = stacks.refusal(arguments, _held_objects(scene, current.values()))
        if refusal:
            raise MotionError(f"action {number}, {action}: {refusal}")
        stacks = stacks.after(arguments)

        index = scene.object_index(arguments["object"])
        attachment = operator.attachment(scene, arguments)
        closed.append(replace(current[index], end=switch))
        current[index] = AttachmentInterval(index, switch, samples, attachment, operator, arguments)

    intervals = [*closed, *current.values()]
    return Timeline(
        tuple(sorted(intervals, key=lambda interval: (interval.start, interval.object)))
    )


def _held_objects(scene: Scene, intervals: Iterable[AttachmentInterval]) -> dict[str, str]:
    """Name of the held object of each arm whose hand is not empty."""
    return {
        scene.workcell.arm_names[interval.holder]: scene.objects[interval.object].name
        for interval in intervals
        if interval.holder is not None
    }


def _read_action(
    scene: Scene, action: Action, operators: Sequence[OperatorCheck], number: int
) -> tuple[OperatorCheck, Arguments]:
    """Operator of an action, and its arguments by the names of the operator's parameters."""
    for operator in operators:
        if operator.name == action.operator and _is_valid(scene, action, operator.parameters):
            names = [parameter.name for parameter in operator.parameters]
            return operator, dict(zip(names, action.arguments, strict=True))
    raise MotionError(f"action {number}, {action}: valid are {_valid_actions(scene, operators)}.")


def _is_valid(scene: Scene, action: Action, parameters: tuple[Parameter, ...]) -> bool:
    """Whether an action has a valid argument for each parameter."""
    if len(action.arguments) != len(parameters):
        return False
    return all(
        argument in parameter.values(scene)
        for argument, parameter in zip(action.arguments, parameters, strict=True)
    )


def _valid_actions(scene: Scene, operators: Sequence[OperatorCheck]) -> str:
    """All operators with their parameters, and the valid values of each parameter."""
    signatures = [
        f"{operator.name}({', '.join(parameter.name for parameter in operator.parameters)})"
        for operator in operators
    ]
    parameters = {
        parameter.name: parameter for operator in operators for parameter in operator.parameters
    }
    values = [
        f"{parameter.plural} {', '.join(parameter.values(scene))}"
        for parameter in parameters.values()
    ]
    return f"{' and '.join(signatures)} with {'; '.join(values)}"
