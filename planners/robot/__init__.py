"""The robot: arms and their presets, kinematics, dynamics, and the distance between an arm and a disc."""
