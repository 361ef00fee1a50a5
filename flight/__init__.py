"""What a flight is and how it is read and written; no physics of vehicles."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
