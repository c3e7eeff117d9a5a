"""Observations of many robots: by kernels where kernels map, else each robot's map is looked at as by itself."""

from typing import Any

import numpy as np

from slamgym.core.types import BoolArray, IntArray, Pose2D, Twist2D
from slamgym.envs.batch.beliefs import Beliefs, KernelTarget
from slamgym.envs.batch.threads import divide_work
from slamgym.envs.compact import CompactObserver
from slamgym.envs.far_look import FarLook
from slamgym.envs.observations import MapView, Measurements, SensedStep, crop_points, make_view


class BatchObserver:
    """Makes the observations of a fleet in the preset of the settings.

    Args:
        beliefs: What the robots believe.
    """

    def __init__(self, beliefs: Beliefs) -> None:
        self._beliefs = beliefs
        self._fleet = beliefs.fleet
        self._config = self._fleet.config
        observation = self._config.observation
        count = len(self._fleet)
        self._measurements = Measurements(self._config)
        self._views: list[MapView] = []  # of robots that are not mapped together
        self._far: Any = None
        self._seen: Any
        view: tuple[float, Any]
        if observation.is_compact:
            compact = CompactObserver.of(self._config)
            self._seen = np.zeros((count, *compact.space.shape), np.float32)
            view = compact.side, compact.limits
        else:
            self._seen = np.zeros((count, *observation.shape), np.uint8)
            view = crop_points(observation, self._config.slam.resolution)
        if beliefs.is_mapped_together:
            beliefs.target = KernelTarget(view, self._seen)
            if observation.preset == "compact_far":
                self._far = FarLook(count, self._config.robot.radius)

    def begin(self, ids: IntArray) -> None:
        """Forget the maps of robots that begin an episode."""
        if not self._beliefs.is_mapped_together:
            for i in ids.tolist():
                self._views[i : i + 1] = [make_view(self._config)]
        elif self._far:
            self._look_far(ids)  # makes room for all, which threads couldn't

    def observe(self, ids: IntArray, is_published: BoolArray) -> Any:
        """The observations of all robots, those of ``ids`` made again.

        Args:
            ids: Those that have sensed.
            is_published: Whose map was published just now, shape (N,).
        """
        beliefs = self._beliefs
        fleet = self._fleet
        if not beliefs.is_mapped_together:
            divide_work(lambda part: self._look(part, is_published), ids, fleet.threads)
        elif self._far:
            divide_work(self._look_far, ids[is_published[ids]], fleet.threads)
            self._far.write(ids, beliefs.maps.believed, self._seen)
        everyone = slice(None)
        return self._with_measurements(self._seen.copy(), everyone)

    def observe_one(self, index: int, is_published: bool) -> Any:
        """The observation of a robot that isn't mapped together with others; a shared map comes as it is."""
        return self._with_measurements(self._look_at(index, is_published), index)

    def _with_measurements(self, seen: Any, rows: Any) -> Any:
        """The observation of some rows, given their maps."""
        if self._config.observation.preset != "dict":
            return seen
        fleet = self._fleet
        believed = self._beliefs.maps.believed[rows]
        times = fleet.times[:, np.newaxis][rows]
        ranges = self._beliefs.ranges[rows]
        return self._measurements.observe(
            seen, ranges, believed, fleet.robots.velocity[rows], times
        )

    def _look_far(self, ids: IntArray) -> None:
        for i in ids.tolist():
            tiles = self._beliefs.tiles(i)
            self._far.refresh(i, tiles.cells, tiles.corner, tiles.resolution)

    def _look(self, ids: IntArray, is_published: BoolArray) -> None:
        for i in ids.tolist():
            self._seen[i] = self._look_at(i, bool(is_published[i]))

    def _look_at(self, index: int, is_published: bool) -> Any:
        beliefs = self._beliefs
        now = SensedStep(
            mapper=beliefs.shown(index),
            ranges=beliefs.ranges[index],
            pose=Pose2D(*beliefs.maps.believed[index].tolist()),
            velocity=Twist2D(*self._fleet.robots.velocity[index].tolist()),
            is_new=bool(beliefs.maps.is_new[index]),
            is_published=is_published,
        )
        return self._views[index].look(now)
