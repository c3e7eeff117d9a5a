"""Floor plan in, honest SLAM map out, and the way back to CAD.

Importing the package registers the environments ``slamgym/Explore-v0``, ``slamgym/ExploreDiscrete-v0``
and ``slamgym/ExploreFrontiers-v0``.
Processes that a vector environment starts afresh may not have imported it: there,
``gym.make("slamgym:slamgym/Explore-v0")`` does so by itself.
"""

from gymnasium.envs.registration import register

__version__ = "0.1.0"
__all__ = ["__version__"]

# Names rather than classes, so that nothing heavy is imported before an environment is made. The environment
# ends its episodes itself (time_limit), so Gymnasium's own limit stays off.
register(id="slamgym/Explore-v0", entry_point="slamgym.envs.explore_env:ExploreEnv")
register(
    id="slamgym/ExploreDiscrete-v0",
    entry_point="slamgym.envs.explore_env:ExploreEnv",
    kwargs={"actions": "discrete"},
)
register(
    id="slamgym/ExploreFrontiers-v0", entry_point="slamgym.envs.explore_frontiers_env:ExploreFrontiersEnv"
)
