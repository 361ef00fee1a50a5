from .compensator import Compensator as Compensator
from .compensator import Result as Result
from .compensator import Settings as Settings
from .observer import Combined as Combined
from .observer import DisturbanceObserver as DisturbanceObserver
from .physics import PhysicsMismatch as PhysicsMismatch
