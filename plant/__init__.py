"""The physics: vehicle, actuation, effects, rigid body, sensors, controller, closed-loop simulation."""
