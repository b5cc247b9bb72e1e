"""k-order motion optimisation of two arms over a skeleton: the NLP, its solver, its verdict."""
