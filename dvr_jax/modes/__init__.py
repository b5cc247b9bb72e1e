"""Kinematic modes: how an object is attached during a phase, and where that puts it.

An object is *fixed* where the scene has it, *placed* where an action has put it, or *held* in a gripper. Each mode has a
file with its pose and with the twists by which the pose changes with the mode parameters.
"""
