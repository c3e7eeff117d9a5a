"""Size of the network that scores frontiers, apart from it, so that reading it needs no torch."""

from dataclasses import dataclass

from slamgym.core.errors import ConfigError
from slamgym.envs.frontier_features import CANDIDATE_FEATURES


@dataclass(frozen=True)
class NetworkConfig:
    """Size of the network."""

    crop: int = 32
    """Units that the crop about a candidate is reduced to."""
    width: int = 64
    """Units of the vector of a candidate."""
    heads: int = 4
    """Heads of the attention."""
    prior_feature: str = "gain_per_way"
    """The score begins as this feature times ``prior_weight``: an untrained network is the greedy rule of
    next best view, and learning goes on from there (residual policy learning, Silver et al. 2018)."""
    prior_weight: float = 16.0
    """0 begins from scratch."""
    exposure_prior: float = 0.0
    """Added to the score for each 1.5 m that the way lies from walls, also on top of weights to start from: a
    negative one begins as a rule that keeps to the walls (coastal navigation, Roy et al. 1999)."""

    def __post_init__(self) -> None:
        if self.width % self.heads:
            raise ConfigError(f"network.width {self.width} must be a multiple of network.heads {self.heads}")
        if self.prior_feature not in CANDIDATE_FEATURES:
            raise ConfigError(f"network.prior_feature: there is no feature {self.prior_feature!r}")
