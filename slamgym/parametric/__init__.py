"""The parametric CAD -> SLAM model: a floor plan and a trajectory in, a SLAM-like map with its field out."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
