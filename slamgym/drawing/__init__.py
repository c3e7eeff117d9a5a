"""From a SLAM map to a drawing: walls, doors and rooms as vectors with true dimensions, and files that CAD reads."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
