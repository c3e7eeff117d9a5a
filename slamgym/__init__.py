"""Floor plan in, honest SLAM map out, and the way back to CAD."""

__version__ = "0.1.0"
__all__ = ["__version__"]
