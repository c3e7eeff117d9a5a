"""Floor plan in, honest SLAM map out, and the way back to CAD.

Importing the package registers the environments ``slamgym/Explore-v4``, ``slamgym/ExploreDiscrete-v4``
and ``slamgym/ExploreFrontiers-v4``.
Processes that a vector environment starts afresh may not have imported it: there,
``gym.make("slamgym:slamgym/Explore-v4")`` does so by itself.

What most programs begin with is here; it is imported when it is first used:

- floor plans: :func:`~slamgym.cad.open_plans`, :class:`~slamgym.cad.FloorPlan`
- exploring: :class:`~slamgym.envs.ExploreEnv`, :class:`~slamgym.envs.ExploreFrontiersEnv`,
  :class:`~slamgym.envs.ExploreConfig`, :class:`~slamgym.envs.RewardConfig`, :class:`~slamgym.sim.RobotConfig`,
  :class:`~slamgym.sim.LidarConfig`, :func:`~slamgym.agents.make_explorer`
- SLAM: :func:`~slamgym.slam.make_mapper`, :class:`~slamgym.slam.SlamConfig`, :func:`~slamgym.interop.open_log`,
  :func:`~slamgym.interop.read_ros_map`, :func:`~slamgym.interop.write_ros_map`
- map pairs: :func:`~slamgym.dataset.build_dataset`, :class:`~slamgym.dataset.DatasetConfig`,
  :func:`~slamgym.dataset.read_manifest`, :func:`~slamgym.dataset.load_pair`,
  :func:`~slamgym.dataset.render_images`; without exploring: :func:`~slamgym.parametric.map_along_path`, or by a
  parametric model: :func:`~slamgym.parametric.deform`
- errors that the user can fix: :class:`~slamgym.core.errors.SlamgymError`
"""

from pathlib import Path

import lazy_loader as lazy
from gymnasium.envs.registration import register

__version__ = "0.1.0"
# In a checkout the folders of slamgym.agents and slamgym.gan lie beside this one (setup.py); installed, they lie in it.
if all((Path(__file__).parents[1] / name).is_file() for name in ("setup.py", "agents/__init__.py")):
    __path__.append(str(Path(__file__).parents[1]))
__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)

# Names rather than classes, so that nothing heavy is imported before an environment is made. The environment
# ends its episodes itself (time_limit), so Gymnasium's own limit stays off.
register(
    id="slamgym/Explore-v4",
    entry_point="slamgym.envs.explore_env:ExploreEnv",
    vector_entry_point="slamgym.envs.batch.env:BatchExploreEnv",
)
register(
    id="slamgym/ExploreDiscrete-v4",
    entry_point="slamgym.envs.explore_env:ExploreEnv",
    vector_entry_point="slamgym.envs.batch.env:BatchExploreEnv",
    kwargs={"actions": "discrete"},
)
register(
    id="slamgym/ExploreFrontiers-v4",
    entry_point="slamgym.envs.explore_frontiers_env:ExploreFrontiersEnv",
)
