"""Makes ``slamgym/ExploreTeam-v0`` as users of PettingZoo expect it, importing PettingZoo only then."""

from typing import TYPE_CHECKING, Any

from slamgym.core.errors import needing_extra
from slamgym.envs.plan_cache import PlansArgument

if TYPE_CHECKING:
    from slamgym.envs.team.env import ExploreTeamEnv


def parallel_env(plans: PlansArgument = "bundled", **settings: Any) -> "ExploreTeamEnv":
    """Make ``slamgym/ExploreTeam-v0``; see :class:`slamgym.envs.team.env.ExploreTeamEnv`.

    Args:
        plans: Floor plans, as for a single robot.
        **settings: As for :class:`~slamgym.envs.team.env.ExploreTeamEnv`.

    Raises:
        ConfigError: If PettingZoo isn't installed, or a setting is unknown or makes no sense.
    """
    with needing_extra("slamgym/ExploreTeam-v0", "teams"):
        from slamgym.envs.team.env import ExploreTeamEnv
    return ExploreTeamEnv(plans, **settings)
