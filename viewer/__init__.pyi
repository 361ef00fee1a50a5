from .page import Page as Page
from .session import Capabilities as Capabilities
from .session import Motion as Motion
from .session import Scene as Scene
from .session import Series as Series
from .session import Session as Session
