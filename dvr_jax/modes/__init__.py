"""Kinematic modes: how an object is attached during a phase, and where that puts it.

An object is *fixed* where the scene has it, *placed* where an action has put it, or *held* in a gripper. Each mode has
a file of its own. The file says which pose the mode parameters give the object, and with which twists the pose changes
as the parameters change. `poses` selects, for each object and slice, the mode that the object is in.
"""
