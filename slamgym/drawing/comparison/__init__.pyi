from .compare import compare
from .config import ComparisonConfig
from .picture import draw_comparison
from .records import Change, Comparison, FaceReport, write_comparison
from .registration import Registration, register

__all__ = [
    "Change",
    "Comparison",
    "ComparisonConfig",
    "FaceReport",
    "Registration",
    "compare",
    "draw_comparison",
    "register",
    "write_comparison",
]
