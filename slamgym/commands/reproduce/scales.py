"""How large a reproduction is."""

from typing import Literal

from slamgym.core.config import Settings

ScaleName = Literal["smoke", "laptop", "full"]


class Scale(Settings):
    """One size of the whole."""

    plans: str
    """As ``slamgym generate --plans`` takes them."""
    plans_filter: str
    recipe: str
    pairs: int
    trajectories: int
    test: float
    """Share of the plans that are for testing."""
    train_preset: str
    train_minutes: float
    """With ``--train`` [min]."""
    explorer_plans: int
    explorers: str
    explorer_split: str
    repeats: int
    """Of the two-sample tests."""
    pictures: int
    """Rows of the picture grids, and maps that are drawn as vectors."""


REPRODUCTION_SCALES: dict[ScaleName, Scale] = {
    "smoke": Scale(
        plans="bundled", plans_filter="none", recipe="quick", pairs=24, trajectories=1, test=0.7,
        train_preset="slam2cad-cpu", train_minutes=0.5,
        explorer_plans=3, explorers="explore_lite,nearest,rl", explorer_split="all", repeats=1, pictures=3,
    ),
    "laptop": Scale(
        plans="json.tar.gz", plans_filter="useful", recipe="quick", pairs=240, trajectories=1, test=0.5,
        train_preset="slam2cad-cpu", train_minutes=60.0,
        explorer_plans=20, explorers="explore_lite,nearest,tour,rl", explorer_split="test", repeats=4, pictures=6,
    ),
    "full": Scale(
        plans="json.tar.gz", plans_filter="useful", recipe="reference", pairs=4550, trajectories=2, test=0.1,
        train_preset="slam2cad", train_minutes=240.0,
        explorer_plans=200, explorers="explore_lite,nearest,next_best_view,tour,rl", explorer_split="test",
        repeats=4, pictures=20,
    ),
}  # fmt: skip
