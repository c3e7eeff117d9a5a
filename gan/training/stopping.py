"""Early stopping: when a training on few pairs has learnt what they teach, and begins to learn them by heart."""

from dataclasses import dataclass


@dataclass
class BestPass:
    """The best wall F1 of the held-out pairs so far, and how long ago that was."""

    wall_f1: float = -1.0
    """Of the weights that are kept; below 0 before the first look."""
    step: int = 0
    """After which they were kept."""
    passes: int = 0
    """Passes over the pairs that have been looked at."""
    passes_since: int = 0
    """Those since the best one."""

    def judge(self, wall_f1: float, step: int, passes: int) -> bool:
        """Take in a look at the held-out pairs; true if the weights are better than all before."""
        self.passes_since += passes - self.passes
        self.passes = passes
        if wall_f1 <= self.wall_f1:
            return False
        self.wall_f1 = wall_f1
        self.step = step
        self.passes_since = 0
        return True
