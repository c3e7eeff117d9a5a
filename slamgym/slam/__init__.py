"""SLAM behind one interface: pose graphs, GMapping's particle filter, known poses, localisation on finished maps."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
