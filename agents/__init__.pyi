from .registry import EXPLORERS, make_explorer

__all__ = ["EXPLORERS", "make_explorer"]
