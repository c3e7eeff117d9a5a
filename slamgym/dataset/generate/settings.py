"""What decides the content of a dataset."""

from dataclasses import field
from typing import Any

from slamgym import __version__
from slamgym.cad import PlanSource, plan_groups
from slamgym.cad.plan_filter import PlanFilter
from slamgym.core.config import Count, Settings, to_dict
from slamgym.dataset.format import FORMAT_VERSION
from slamgym.dataset.generate.recipe import Recipe, check_recipe
from slamgym.dataset.pair import PairConfig
from slamgym.dataset.schedule import ids_digest
from slamgym.envs.episode import EpisodeConfig


class DatasetConfig(Settings):
    """Everything that decides the content of a dataset, apart from the plans."""

    seed: int = 0
    """Seed of the whole dataset; explorations derive theirs from it, the plan id and the repetition."""
    plans_filter: PlanFilter = "none"
    """``useful`` takes homes that are worth exploring: 2-20 rooms, 20-300 m2, at most 30 m long, at most
    1,500 vertices."""
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
    """The exploration."""
    pair: PairConfig = field(default_factory=PairConfig)
    """The images."""
    trajectories: Count = 1
    """Explorations of a plan that come one after the other: several SLAM maps of one CAD map."""
    recipe: Recipe = field(default_factory=Recipe)
    """What varies from one exploration to the next."""

    def _check(self) -> None:
        check_recipe(self.recipe, self.episode)


def dataset_settings(config: DatasetConfig, plans: PlanSource) -> dict[str, Any]:
    """The content of ``config.json``: two datasets with the same one have the same pairs."""
    return {
        "format_version": FORMAT_VERSION,
        "version": __version__,
        "plans": [
            {"count": len(group.ids), "sha256": ids_digest(group.ids), "weight": group.weight}
            for group in plan_groups(plans)
        ],
        **to_dict(config),
    }
