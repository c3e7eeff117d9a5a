from .compare import compare_with_plan
from .picture import draw_comparison
from .records import PlanComparison, PlanFinding, write_comparison
from .registration import Registration, register

__all__ = [
    "PlanFinding",
    "PlanComparison",
    "Registration",
    "compare_with_plan",
    "draw_comparison",
    "register",
    "write_comparison",
]
