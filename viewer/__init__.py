"""Shows flights and asks for work through a protocol of its own; knows neither learn nor compensate."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
