"""From a SLAM map to a drawing with true dimensions, and what it shows that differs from a floor plan."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
