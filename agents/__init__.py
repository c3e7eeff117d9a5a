"""Explorers: policies that drive a robot through an unknown building.

All of them satisfy Stable-Baselines3's ``PolicyPredictor``.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
