"""The physics: vehicle, actuation, effects, rigid body, sensors, controller, closed-loop simulation."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
