"""The page: flights in 3D, plots, and the tabs of a session, which it asks through a protocol of its own."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
