from .page import Page as Page
from .scene import Motion as Motion
from .scene import Scene as Scene
from .scene import Series as Series
from .session import Capabilities as Capabilities
from .session import Session as Session
