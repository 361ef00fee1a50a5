"""Shows flights, and the tabs that a session brings, through a protocol of its own; knows no learn or compensate."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
