from .compensator import Compensator as Compensator
from .compensator import Result as Result
from .compensator import Settings as Settings
from .feedback import INDI as INDI
from .feedback import L1 as L1
from .observer import Combined as Combined
from .observer import DisturbanceObserver as DisturbanceObserver
from .physics import PhysicsMismatch as PhysicsMismatch
