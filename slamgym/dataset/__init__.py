"""Map pairs: explorations of floor plans, and the folder in which they are kept."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
