"""A floor plan and a path in, a SLAM map with its field out: the simulated robot's, or the parametric model's."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
