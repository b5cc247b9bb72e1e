"""Compile, or load, all programs that searches on scenes of one size use."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp

from dvr_jax.logic import Action
from dvr_jax.modes.mode import PARAMETERS
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.transcription import transcribe, walk
from dvr_jax.operators import OPERATORS, Operator, operator_of
from dvr_jax.scene.types import Scene
from dvr_jax.search.goal_guide import GoalGuide
from dvr_jax.search.one_fact import network_for
from dvr_jax.search.predictor import Encoding, Images, SequencePredictor
from dvr_jax.search.searches import has_several_facts
from dvr_jax.search.tree import SequenceTree
from dvr_jax.seeds.beam_batches import BeamTask, extend_beams, prepare_penetration
from dvr_jax.seeds.initial_paths import initial_path, optimal_path_problem, path_problem
from dvr_jax.seeds.keyframe_beam import beam_capacity, empty_beam
from dvr_jax.solver.continuous_collision import sample_penetration
from dvr_jax.solver.lane_pool import AnySettings, LanePool, NlpTask, stack
from dvr_jax.solver.sequential import SequentialSettings
from dvr_jax.solver.state import Settings, Termination
from dvr_jax.workcell.model import WorkcellModel, workcell_model

Job = Callable[[], None]


class Programs:
    """Calls that compile the programs of scenes like a given one."""

    def __init__(self, scene: Scene, k_max: int, operators: Sequence[Operator]) -> None:
        """Transcribe sequences of every length.

        Args:
            scene: Any scene of the size that is wanted; what it asks for is not solved.
            k_max: Largest number of actions.
            operators: The operators that are known.
        """
        self.model: WorkcellModel = workcell_model(scene.workcell)
        self.k_max = k_max
        self.operators = operators
        self.settings = Settings()
        actions = covering_sequence(scene, k_max, operators)
        lengths = range(1, len(actions) + 1)
        self.problems: dict[int, Problem] = {
            K: transcribe(scene, actions[:K], operators=operators) for K in lengths
        }
        self.proposals = [
            operator_of(action, operators).proposal(state.modes[switch.item].kind)
            for action, state, switch in zip(
                actions, *walk(scene, actions, (), operators), strict=False
            )
        ]

    def keyframes(self, length: int) -> None:
        """Compile the programs of a keyframe NLP."""
        start = self._home(length)
        self._pool(self.problems[length], start, self.settings).prepare()

    def path(self, length: int) -> None:
        """Compile the programs of a path NLP, and look between the samples of a path."""
        problem = self.problems[length]
        start = initial_path(self.model, problem, self._home(length))
        path = path_problem(problem, start)
        self._pool(path, start, self.settings).prepare()
        sample_penetration(self.model, stack([path]), stack([start]))

    def optimum(self, length: int) -> None:
        """Compile the programs of the optimization of a path."""
        problem = self.problems[length]
        start = initial_path(self.model, problem, self._home(length))
        path = optimal_path_problem(problem, start)
        self._pool(path, start, SequentialSettings()).prepare()

    def _pool(self, problem: Problem, start: Variables, settings: AnySettings) -> LanePool:
        """Return a pool for one NLP, which is not solved."""
        return LanePool(self.model, [NlpTask(problem, start)], settings)

    def beam(self, length: int) -> None:
        """Compile the programs that extend beams to a number of actions, the most expensive one first."""
        beam = empty_beam(*self._beam_sizes())
        task = BeamTask(beam, self.problems[length], self.proposals[length - 1])
        prepare_penetration(self.model, task)
        self.extend()

    def extend(self) -> None:
        """Extend a beam along the sequence."""
        beam = empty_beam(*self._beam_sizes())
        for length, proposal in enumerate(self.proposals, start=1):
            (beam,) = extend_beams(self.model, [BeamTask(beam, self.problems[length], proposal)], 0)

    def _beam_sizes(self) -> tuple[int, int, int]:
        """Return the numbers of objects, of actions that beams have room for, and of joints."""
        problem = self.problems[1]
        return len(problem.prism), beam_capacity(self.k_max), len(problem.home)

    def _home(self, length: int) -> Variables:
        problem = self.problems[length]
        return Variables(jnp.tile(problem.home, (length, 1)), jnp.zeros((length, PARAMETERS)))


def covering_sequence(
    scene: Scene, length: int, operators: Sequence[Operator] = OPERATORS
) -> tuple[Action, ...]:
    """A sequence in which every way to sample an action occurs early.

    Whether it can be done does not matter, nor whether it reaches the goal.

    Args:
        scene: A valid scene.
        length: Number of actions.
        operators: The operators that are known.
    """
    grounding = SequenceTree(scene, length, operators=operators).grounding
    state = grounding.initial_state
    actions: list[Action] = []
    seen: dict[str, int] = {}
    while len(actions) < length:
        allowed = [(index, grounding.actions[index]) for index in grounding.applicable(state)]
        names = [_proposal_name(scene, (*actions, action), operators) for _, action in allowed]
        if not names:
            break
        # Of the actions that are allowed, the one whose way of sampling has occurred least.
        chosen = min(range(len(names)), key=lambda i: seen.get(names[i], 0))
        index, action = allowed[chosen]
        seen[names[chosen]] = seen.get(names[chosen], 0) + 1
        actions.append(action)
        state = grounding.successor(state, index)
    return tuple(actions)


def _proposal_name(scene: Scene, actions: Sequence[Action], operators: Sequence[Operator]) -> str:
    """How the last action of a sequence is sampled."""
    states, switches = walk(scene, actions, (), operators)
    before = states[-2].modes[switches[-1].item].kind
    return operator_of(actions[-1], operators).proposal(before).name


def warm_up(
    scene: Scene,
    k_max: int = 6,
    network: SequencePredictor[Images, Encoding] | None = None,
    operators: Sequence[Operator] = OPERATORS,
    termination: Termination = Termination.OPTIMAL,
) -> None:
    """Compile or load every program: those of the NLPs of 1 to `k_max` actions, of beams, and of the network.

    Args:
        scene: Any scene of the size that is wanted; what it asks for is not solved.
        k_max: Largest number of actions.
        network: The network that guides the search, if any.
        operators: The operators that are known.
        termination: Whether paths will be optimized.
    """
    with jax.enable_x64(True):
        programs = Programs(scene, k_max, operators)
        for job in all_jobs(programs, scene, network, termination):
            job()


def all_jobs(
    programs: Programs,
    scene: Scene,
    network: SequencePredictor[Images, Encoding] | None,
    termination: Termination,
) -> list[Job]:
    """Return what has to be compiled, in the order in which a search without a network comes to need it.

    Args:
        programs: Calls that compile.
        scene: Scene of the size that is wanted.
        network: The network that guides the search, if any.
        termination: Whether paths will be optimized.
    """
    lengths = list(programs.problems)
    jobs: list[Job] = [] if network is None else [partial(query, programs, scene, network)]
    jobs += [partial(programs.keyframes, length) for length in lengths]
    jobs.append(programs.extend)
    jobs += [partial(programs.path, length) for length in lengths]
    if termination == Termination.OPTIMAL:
        jobs += [partial(programs.optimum, length) for length in lengths]
    return jobs


def query(programs: Programs, scene: Scene, network: SequencePredictor[Images, Encoding]) -> None:
    """Ask a network for one child and for as many as there may be.

    Args:
        programs: Calls that compile.
        scene: Scene of the size that is wanted.
        network: The network.
    """
    tree = SequenceTree(scene, programs.k_max, operators=programs.operators)
    if has_several_facts(scene):
        children = tree.expand(tree.root)
        GoalGuide(tree, network).rank(tree.root, children)
        return

    asked = network_for(scene, network, programs.operators)
    encoding = asked.encode_scene(scene, tree.grounding)
    widest = len(tree.grounding.applicable(tree.grounding.initial_state))
    for number in (1, widest):
        asked.predict(encoding, encoding.initial_hidden(), range(number))
