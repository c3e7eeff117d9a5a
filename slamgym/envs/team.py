"""Several robots in one building: ``slamgym/ExploreTeam-v0``, made as PettingZoo's users expect it.

::

    from slamgym.envs import team

    env = team.parallel_env("bundled", robots=3)
"""

from typing import TYPE_CHECKING, Any

from slamgym.core.errors import needing_extra
from slamgym.envs.plan_cache import PlansArgument

if TYPE_CHECKING:
    from slamgym.envs.team_env import ExploreTeamEnv


def parallel_env(plans: PlansArgument = "bundled", **settings: Any) -> "ExploreTeamEnv":
    """Make ``slamgym/ExploreTeam-v0``; see :class:`slamgym.envs.team_env.ExploreTeamEnv`.

    Args:
        plans: Floor plans, as for a single robot.
        **settings: As for :class:`~slamgym.envs.team_env.ExploreTeamEnv`.

    Raises:
        ConfigError: If PettingZoo isn't installed, or a setting is unknown or makes no sense.
    """
    with needing_extra("slamgym/ExploreTeam-v0", "teams"):
        from slamgym.envs.team_env import ExploreTeamEnv
    return ExploreTeamEnv(plans, **settings)
