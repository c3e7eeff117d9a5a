"""Settings of the mapper, named after GMapping's parameters where they have one."""

from dataclasses import field
from typing import Annotated, Literal

from slamgym.core.config import Count, NonNegative, Positive, Settings, Within

Mode = Literal["rbpf", "pose_graph", "dead_reckoning", "map", "ground_truth"]


SEES_ACROSS_ROOMS = 10.0
"""A scanner with more range than this sees walls wherever it is indoors, and no return means glass or an error [m]."""
MOST_RANGE = 80.0
"""Returns beyond this are not used [m]."""
RANGE_MARGIN = 0.05
"""Returns that fall short of the scanner's limit by less than this are not used [m]."""
MANY_BEAMS = 540
"""Of a scan with several times as many beams, only such a part is matched."""


class MotionNoise(Settings, section="slam.motion"):
    """Trust in the odometry: standard deviations per odometry increment, as GMapping's motion model.

    The defaults are the launch values of TurtleBot3's GMapping, which are GMapping's own.
    """

    srr: NonNegative = 0.1
    """Translation error per metre of translation [m/m]."""

    srt: NonNegative = 0.2
    """Rotation error per metre of translation [rad/m]."""

    str: NonNegative = 0.1
    """Translation error per radian of rotation [m/rad]."""

    stt: NonNegative = 0.2
    """Rotation error per radian of rotation [rad/rad]."""


class PoseGraphConfig(Settings, section="slam.pose_graph"):
    """When loops are sought. The defaults serve indoor scanners of 3 to 80 m range."""

    loop_length: NonNegative = 5.0
    """Only nodes that lie further back than this along the graph make a loop [m]."""


class LocalizationConfig(Settings, section="slam.localization"):
    """Settings for localising a robot on a map, named after AMCL's parameters where it has them.

    Each of several hypotheses is a Kalman filter (multi-hypothesis tracking; Jensfelt and Kristensen 2001), weighed
    by the likelihood field of Thrun, Burgard and Fox (*Probabilistic Robotics*, 2005, Table 6.3) along its rays.
    """

    start: Literal["global", "known"] = "global"
    """``global``: nothing is known of the start; ``known``: the start is the initial pose, as in AMCL."""

    confirm_distance: NonNegative = 3.0
    """So far the robot must have driven with one hypothesis certain before it is believed [m]; half a turn counts as
    much as a metre. Twice as far after each place that was believed and given up."""


class SlamConfig(Settings, section="slam"):
    """Settings for making the map.

    The defaults are TurtleBot3's GMapping launch file (``turtlebot3_slam/config/gmapping_params.yaml``), except for the
    number of particles and the minimum score, where GMapping's own defaults of 30 and 0 stand (the launch file says 100
    and 50), the usable range and the meaning of no return.
    """

    mode: Mode = "pose_graph"
    """``pose_graph``: closes loops globally; ``rbpf``: GMapping's particle filter; ``dead_reckoning``: believes the
    odometry; ``map``: finds itself on a finished map
    (:mod:`slamgym.slam.localization`); ``ground_truth``: as dead reckoning, for a caller who hands it true poses."""

    particles: Annotated[int, Within(ge=1, le=10_000)] = 30
    """Number of particles (``particles``). A single one draws no noise: with 1, ``rbpf`` is scan matching."""

    resolution: Annotated[float, Within(gt=0.0, le=1.0)] = 0.05
    """Cell size of the maps [m] (``delta``)."""

    max_usable_range: Annotated[float, Within(gt=0.0, le=1000.0)] = 3.45
    """Longer returns are not matched; their rays are cut here and clear free space only [m]
    (``maxUrange``, 3.0 in the launch file). A little less than the scanner's own limit, where noise decides whether
    a beam returns."""

    sigma: Positive = 0.05
    """Width of the matching score exp(-d^2 / sigma) [m^2] (``sigma``)."""

    iterations: Annotated[int, Within(ge=0, le=100)] = 5
    """Number of times that GMapping's search halves its steps (``iterations``)."""

    beam_skip: Annotated[int, Within(ge=0, le=1000)] = 0
    """Beams left out between two that are matched (``lskip``); all are drawn into the map."""

    minimum_score: float = 0.0
    """A match with a lower score is refused and odometry stands (``minimumScore``). 0 is GMapping's default.
    With the launch file's 50 a robot that sees few walls isn't matched at all and its particles scatter."""

    motion: MotionNoise = field(default_factory=MotionNoise)
    """Noise of the motion model."""

    linear_update: float = 1.0
    """A scan is processed after this distance [m] (``linearUpdate``)."""

    angular_update: float = 0.2
    """A scan is processed after this turn [rad] (``angularUpdate``)."""

    temporal_update: float | None = 0.5
    """A scan is processed when more than this time has passed [s] (``temporalUpdate``); None turns it off."""

    resample_threshold: float = 0.5
    """Resample when N_eff falls below this share of the particles (``resampleThreshold``)."""

    occupied_threshold: Annotated[float, Within(gt=0.0, lt=1.0)] = 0.25
    """A cell is occupied when more than this share of its observations are hits (``occ_thresh``)."""

    min_passes: Count = 1
    """A cell is known once so many beams have met or crossed it. GMapping: 1; Karto: 3, as more than its
    ``MinimumPassThrough`` of 2 are needed."""

    counting: Literal["beams", "scans"] = "beams"
    """``beams``: each beam that crosses a cell counts, as in GMapping and Karto; ``scans``: a scan counts once, as
    a hit if one of its beams ends in the cell, as in Cartographer."""

    occupied_margin: NonNegative = 0.0
    """A cell is occupied when its hits exceed ``occupied_threshold`` x observations by more than this. Log-odds of
    a for a hit and -b for a miss that must pass A are a threshold of b / (a + b) and a margin of A / (a + b)."""

    free_margin: NonNegative = 0.0
    """A cell is free when its hits fall short of ``occupied_threshold`` x observations by this; between the two
    margins it is unknown, as where map_saver cuts probabilities. 0, as in GMapping: seen is free or occupied. Both
    margins bear on the map that is saved, not on the one that is driven by: its shades say more."""

    no_return: Literal["clear", "ignore"] = "clear"
    """Meaning of a beam without return. ``clear``: its ray is free up to the line between the returns next to
    the gap, or up to the usable range where the gap is half a turn wide, as in the middle of a large room.
    ``ignore``: nothing, as stock slam_gmapping; then the middle of a room larger than the range stays unknown
    for ever and exploration never ends there. Use it for logs whose missing returns may be errors."""

    memory_limit_mb: Positive = 4096.0
    """The maps may take this much memory [MB]; beyond it the mapper stops with a clear error."""

    pose_graph: PoseGraphConfig = field(default_factory=PoseGraphConfig)
    """Settings of the mode ``pose_graph``."""

    localization: LocalizationConfig = field(default_factory=LocalizationConfig)
    """Settings of the mode ``map``, and of the search for the place where an older map is continued."""

    @staticmethod
    def gmapping(particles: int = 30) -> "SlamConfig":
        """The launch file's settings with so many particles, also where the defaults differ from it."""
        return SlamConfig(
            mode="rbpf",
            particles=particles,
            minimum_score=50.0,
            max_usable_range=3.0,
            no_return="ignore",
        )

    @staticmethod
    def for_log(max_range: float, num_beams: int) -> "SlamConfig":
        """Settings for a recorded log: with any scanner, a scan is processed every 0.1 m, 0.1 rad and 1 s.

        Args:
            max_range: Largest range the scanner reports [m].
            num_beams: Beams of a scan; of very many only a part is matched.
        """
        sees_across_rooms = max_range > SEES_ACROSS_ROOMS
        usable = min(max_range, MOST_RANGE) - RANGE_MARGIN
        return SlamConfig(
            mode="pose_graph",
            max_usable_range=max(usable, 0.5 * max_range),
            beam_skip=num_beams // MANY_BEAMS,
            linear_update=0.1,
            angular_update=0.1,
            # Odometry that stands still while the robot drives is found by its scans.
            temporal_update=1.0,
            no_return="ignore" if sees_across_rooms else "clear",
        )
