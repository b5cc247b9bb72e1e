"""The Franka Panda arm: its MuJoCo model, its constants, its closed-form inverse kinematics."""
