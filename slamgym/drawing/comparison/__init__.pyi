from .compare import compare_with_plan
from .picture import draw_comparison
from .records import Finding, PlanComparison, write_comparison
from .registration import Registration, register

__all__ = [
    "Finding",
    "PlanComparison",
    "Registration",
    "compare_with_plan",
    "draw_comparison",
    "register",
    "write_comparison",
]
