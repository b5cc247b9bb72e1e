"""The relaxation of a scene whose goal is a conjunction of facts: a lower bound on the number of actions.

Each action switches one object. So the numbers of actions on different objects add up, and each of them is at least the
length of a shortest walk in the graph of that object alone (`dvr_jax.search.object_graph`) to a vertex at which all
conditions on the object hold: it is on its region, in its hand, in no hand, or off a region that has to be clear.
A walk has no length where the conditions hold at the start.

Another object *blocks* if an object that the goal names finds no walk of an allowed length while it stands where the
scene has it. An object that blocks and that no condition moves anyway has to be moved, which takes two actions: it is
grasped, and it leaves the gripper again. One action suffices for as many of them as arms may hold an object at the
end that the goal does not name (`free_arms_at_end`). What stands on an object that has to be moved has to be moved too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from dvr_jax.goals import EndCondition, On
from dvr_jax.logic import Action
from dvr_jax.operators import object_of
from dvr_jax.scene.stacks import objects_above
from dvr_jax.scene.start import end_conditions
from dvr_jax.scene.types import Scene
from dvr_jax.search.object_graph import UNREACHED, Vertex
from dvr_jax.search.relaxation import MOVE, Relaxation
from dvr_jax.search.work import Steps


def free_arms_at_end(scene: Scene, conditions: Sequence[EndCondition]) -> int:
    """Return how many arms may hold an object at the end that the goal does not name.

    Where every fact is that an object is on a region, the last action places one of them, and its arm is empty.

    Args:
        scene: A valid scene.
        conditions: The conditions of its goal.
    """
    arms = set(scene.workcell.arm_names)
    barred = {
        arm
        for arm in arms
        if all(
            EndCondition(("holding", arm, name), name, holds=False) in conditions
            for name in scene.object_names
        )
    }
    taken = {c.fact[1] for c in conditions if c.holds and c.fact[0] == "holding"}
    free = len(arms - barred - taken)
    ends_with_place = all(isinstance(fact, On) for fact in scene.goal.facts)
    return min(free, len(arms) - 1) if ends_with_place else free


class ConjunctionBound(Relaxation):
    """Lower bounds for a goal of several facts; it replaces the bounds of `Relaxation` for the paper's goal."""

    _conditions: tuple[EndCondition, ...] | None = None

    @property
    def conditions(self) -> tuple[EndCondition, ...]:
        """The conditions of the goal."""
        if self._conditions is None:
            self._conditions = end_conditions(self.solver.scene)
        return self._conditions

    @property
    def goal_objects(self) -> tuple[str, ...]:
        """Names of the objects that have to be switched, because a condition on them does not hold at the start."""
        return tuple(
            name
            for name in self.solver.scene.object_names
            if self.walks.graph(name).root not in self.walks.graph(name).goals
        )

    @property
    def goal_object(self) -> str:
        """Name of the first object of the goal that cannot reach its conditions, or else of the first object."""
        names = self.goal_objects or self.solver.scene.object_names
        stuck = [name for name in names if self._distance_alone(name) >= UNREACHED]
        return (*stuck, *names)[0]

    def compute(self, limit: int) -> Steps[int]:
        """Compute the lower bound of the scene.

        Args:
            limit: Number of actions above which the exact value of the bound does not matter.

        Returns:
            The bound, which is also stored.
        """
        if self._limit >= limit:
            return self.lower_bound
        self._limit = limit
        self.is_computed = False
        lengths: dict[str, int] = {}
        for name in self.goal_objects:
            worlds = (self.walks.others(name),)
            lengths[name] = yield from self.walks.shortest(name, worlds, limit)
        self.alone = min(sum(lengths.values()), UNREACHED)
        self.lower_bound = self.alone
        self._remaining.clear()
        if self.alone > limit:
            self.is_computed = True
            return self.alone

        required: dict[str, None] = {}
        for name in self.goal_objects:
            rest = self.alone - lengths[name]
            blockers = yield from self._blockers_of(name, limit - rest)
            required.update(dict.fromkeys(blockers))
        # What stands on an object has to be moved before it.
        for name in list(required):
            above = objects_above(self.solver.scene, name)
            required.update(dict.fromkeys(set(above) - set(self.goal_objects)))
        yield from self._judge_first_grasps(list(required))
        self._remaining.clear()
        self.required = frozenset(required)
        self.lower_bound = min(self.alone + self._cost_of_moving(self.required), UNREACHED)
        self.is_computed = True
        return self.lower_bound

    def _blockers_of(self, name: str, limit: int) -> Steps[list[str]]:
        """Return the objects that have to be moved for an object, and that no condition moves anyway."""
        found = []
        targets = [c.fact[-1] for c in self.conditions if c.item == name and c.holds]
        regions = [target for target in targets if target in self.solver.scene.region_names]
        for other in sorted(self.walks.others(name) - set(self.goal_objects)):
            is_in_the_way = any(other in self._obstructions_of(name, region) for region in regions)
            if is_in_the_way or other in objects_above(self.solver.scene, name):
                found.append(other)
                continue
            worlds = (self.walks.others(name), self.walks.others(name, other))
            if (yield from self.walks.shortest(name, worlds, limit)) > limit:
                found.append(other)
        return found

    def _cost_of_moving(self, names: Iterable[str]) -> int:
        """Return the least number of actions that move these objects."""
        cost = 0
        can_be_held = 0
        for name in names:
            graph = self.walks.graph(name)
            is_open = self.walks.is_open(name)
            first = [edge.action for edge in graph.edges_from[graph.root] if is_open(edge)]
            if not first:
                return UNREACHED
            is_grasped = all(map(self._is_grasp, first))
            # An object that has to be where it was comes back, or ends in a hand: it needs two actions as well.
            cost += MOVE if is_grasped else MOVE - 1
            can_be_held += is_grasped
        return cost - min(can_be_held, free_arms_at_end(self.solver.scene, self.conditions))

    def remaining(self, actions: Sequence[Action]) -> int:
        """Return a lower bound on the number of actions after a prefix, from the verdicts that are known.

        Args:
            actions: The prefix, which does not reach the goal.
        """
        if self._limit < 0:
            return 0
        chains: dict[str, tuple[Action, ...]] = dict.fromkeys(self.goal_objects, ())
        for action in actions:
            name = object_of(action, self._operators)
            chains[name] = (*chains.get(name, ()), action)

        total = 0
        for name, chain in chains.items():
            vertex = self._vertex_after(name, chain)
            if vertex is None:
                return UNREACHED
            total += self._distances_of(name).get(vertex, UNREACHED)
        total += self._cost_of_moving(self.required - set(chains))
        return min(total, UNREACHED)

    def _vertex_after(self, name: str, chain: tuple[Action, ...]) -> Vertex | None:
        """Return the vertex after actions on an object."""
        if not chain:
            return self.walks.graph(name).root
        if chain not in self._vertices:
            self._vertices[chain] = self.walks.graph(name).vertex_after(chain)
        return self._vertices[chain]

    def _distances_of(self, name: str) -> dict[Vertex, int]:
        """Return the distances to the conditions in the graph of an object."""
        if name not in self._remaining:
            is_open = self.walks.is_open(name)
            self._remaining[name] = self.walks.graph(name).distances_to_goal(is_open)
        return self._remaining[name]

    def _distance_alone(self, name: str) -> int:
        """Return the length of a shortest walk of an object as far as windows are known."""
        return self._distances_of(name).get(self.walks.graph(name).root, UNREACHED)

    def least_without_limit(self) -> int:
        """Return the lower bound for any limit, from the verdicts that are known."""
        alone = sum(self._distance_alone(name) for name in self.goal_objects)
        return min(max(alone, self.remaining(())), UNREACHED)

    def _moving_cost(self, names: Sequence[str]) -> int:
        """Return the least number of actions that move these objects."""
        return self._cost_of_moving(names)


def relaxation_type(scene: Scene) -> type[Relaxation]:
    """Return the type of the relaxation that fits a scene's goal."""
    return Relaxation if scene.goal.regions else ConjunctionBound
