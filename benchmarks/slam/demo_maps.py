"""Maps of ``make demo``, whose explorer drives by the mapper's own pose."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from drives import DEMO_PLANS, DEMO_SEED, demo_slots

from slamgym.agents.registry import make_explorer
from slamgym.core.intervals import mean_interval
from slamgym.dataset import DatasetConfig, PairRecord
from slamgym.dataset.generate.exploration import ExplorationTask, run_exploration
from slamgym.envs import EpisodeConfig, ExploreConfig
from slamgym.slam import SlamConfig

COLUMNS = (
    "mode", "wall error of make demo [m]", "worst [m]", "explorations", "wall error [m]", "95 %",
    "RMSE [m]",
)  # fmt: skip


def demo_figures(config: SlamConfig, seeds: int) -> dict[str, Any]:
    """The explorations of ``make demo``, and as many with further seeds."""
    records = [
        record
        for seed in range(DEMO_SEED, DEMO_SEED + seeds)
        for record in demo_records(config, seed)
    ]
    errors = np.array([record.map_error for record in records])
    interval = mean_interval(errors)
    return {
        "wall error of make demo [m]": round(float(errors[:DEMO_PLANS].mean()), 3),
        "worst [m]": round(float(errors[:DEMO_PLANS].max()), 3),
        "explorations": len(errors),
        "wall error [m]": round(interval.value, 3),
        "95 %": f"{interval.low:.3f}-{interval.high:.3f}",
        "RMSE [m]": round(float(np.mean([record.ate for record in records])), 3),
    }


def demo_records(slam: SlamConfig, seed: int) -> list[PairRecord]:
    """Pairs of ``slamgym generate --plans bundled --pairs 8``."""
    config = DatasetConfig(seed=seed, episode=EpisodeConfig(env=ExploreConfig(slam=slam)))
    records = []
    for plan, slot in demo_slots(seed):
        with TemporaryDirectory() as folder:
            staged = Path(folder) / "pair"
            run_exploration(ExplorationTask(slot, plan, staged, config, make_explorer))
            records.append(PairRecord.from_line((staged / "episode/episode.json").read_text()))
    return records
