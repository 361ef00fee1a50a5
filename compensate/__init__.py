"""Turns a learned mismatch into a correction of the commanded wrench, sample by sample."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
