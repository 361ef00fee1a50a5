"""A model in the terms of another program: parameters of autopilots, descriptions of simulators."""

TARGETS = {
    "px4": ".params",
    "ardupilot": ".param",
    "crazyflie": ".csv",
    "mjcf": ".xml",
    "sdf": ".sdf",
    "urdf": ".urdf",
    "rotorpy": ".py",
    "drone-models": ".toml",
}
"""What a model can be written for, and how the files end."""
