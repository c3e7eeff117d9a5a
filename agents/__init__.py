"""Explorers: policies that drive a robot through an unknown building.

All of them satisfy Stable-Baselines3's ``PolicyPredictor``.
"""

from slamgym.agents.registry import EXPLORERS, make_explorer

__all__ = ["EXPLORERS", "make_explorer"]
