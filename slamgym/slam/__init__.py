"""SLAM: a grid-mapping particle filter as GMapping, and simpler modes behind the same protocol."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
