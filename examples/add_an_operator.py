"""Add an action operator: where to begin.

The script lists the operators that the package has. `docs/extending.md` describes the fields of an operator, and how
one of your own is passed to `plan`.
"""

import dvr_jax as dvr

# An operator is one value: its logic, its phrase, its mode switch and its proposals are fields of it.
for operator in dvr.OPERATORS:
    print(operator)

# Every action of a plan is an instance of one of them, and has a text form that is accepted in place of an action.
action = dvr.Action.parse("grasp(left, +x, yellow)")
print(f"{action}: operator {action.operator!r} with the arguments {action.arguments}")

# Planning uses the operators that it is given: plan(scene, operators=(*dvr.OPERATORS, MINE)).
