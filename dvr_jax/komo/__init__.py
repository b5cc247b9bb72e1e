"""k-order motion optimisation of two arms over a skeleton: the NLP, its solver, its verdict.

Given a scene and a sequence of actions (`dvr_jax.feasibility` does all of this, with many starts and the check):

    with jax.enable_x64(True):                       # tolerances ask for double precision
        problem = transcribe(scene, actions)                         # transcription: the keyframe NLP
        (keyframes,) = solve([problem], [variables], Settings())     # engine; variables: q (K, 14), m (K, 4)
        start = path_start(problem, Variables(keyframes.q, keyframes.m))           # starts
        (path,) = solve([path_problem(problem, start)], [start], Settings())

Costs and constraints are those of grasps and places by two Pandas. The augmented-Lagrangian method itself (`augmented`)
knows nothing of them: tests/komo/test_hock_schittkowski.py solves other problems with it."""
