"""The nonlinear program of one action sequence: variables, costs, constraints, tolerances."""
