from .comparison import ComparisonConfig, PlanComparison, compare_with_plan

__all__ = ["PlanComparison", "ComparisonConfig", "compare_with_plan"]
