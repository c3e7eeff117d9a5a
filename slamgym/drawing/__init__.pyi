from .comparison import Comparison, ComparisonConfig, compare

__all__ = ["Comparison", "ComparisonConfig", "compare"]
