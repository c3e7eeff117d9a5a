"""Several robots in one building: ``slamgym/ExploreTeam-v0``, made as PettingZoo's users expect it.

::

    from slamgym.envs import team

    env = team.parallel_env("bundled", robots=3)
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
