"""The two Franka Panda arms as arrays: kinematic chain, collision capsules, inverse kinematics."""
