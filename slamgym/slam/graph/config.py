"""Settings of the mode ``pose_graph``."""

from slamgym.core.config import Count, Positive, Settings


class PoseGraphConfig(Settings, section="slam.pose_graph"):
    """How scans are matched and loops are closed. The defaults serve indoor scanners of 3 to 80 m range."""

    keyframe_distance: Positive = 0.5
    """A scan becomes a node after this distance [m]; the mapper's own update thresholds don't count ..."""

    keyframe_turn: Positive = 0.2
    """... or after this turn [rad]."""

    match_range: Positive = 25.0
    """Longer returns are not matched (but drawn) [m]."""

    cell: Positive = 0.1
    """Cell size of the local maps that scans are matched with [m]."""

    surface_sigma: Positive = 0.02
    """Standard deviation of end points across a wall [m]."""

    point_share: Positive = 0.05
    """What a point counts in the information of a match: neighbouring points err together."""

    local_nodes: Count = 30
    """A new scan is matched with this many nodes before it."""

    minimum_fit: float = 0.45
    """A match with its predecessors counts if this share of the points fits; else odometry stands."""

    loop_interval: Count = 2
    """A loop is sought at every so many nodes."""

    loop_length: float = 5.0
    """Only nodes that lie further back than this along the graph make a loop [m]."""

    loop_radius: float = 3.0
    """A loop is sought with nodes this near, plus the uncertainty that has accumulated [m]."""

    drift: float = 0.04
    """Uncertainty of position that accumulates per metre along the graph [m/m] ..."""

    drift_turn: float = 0.012
    """... and of heading [rad/m]."""

    largest_window: float = 6.0
    """Most position uncertainty that a loop is searched in [m]."""

    loop_fit: float = 0.7
    """A loop closure needs this share of fitting points ..."""

    final_fit: float = 0.5
    """... and this at the end, when the places are known."""

    trusted_window: float = 0.6
    """Within this uncertainty one match is enough; beyond it, a closure waits for others that agree [m]."""

    agreeing: int = 2
    """How many other closures must agree with it then."""

    robust_width: float = 8.0
    """Chi-squared beyond which a loop closure loses its pull (dynamic covariance scaling)."""

    final_passes: int = 0
    """How often, at the end, all nodes are matched with their neighbours once more: good for scanners that see across
    rooms (see :meth:`slamgym.slam.SlamConfig.for_log`)."""
