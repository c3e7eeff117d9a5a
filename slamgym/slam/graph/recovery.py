"""Recovery from wrong alignments: searches round the predicted pose for a place that explains a scan better.

The evidence for another place is a log-likelihood: what its better fit gains must make up for the odometry, and for
what the best of so many places fits by chance. In a wide window a point that fits nothing says so much only where the
scan before, or this one, saw through the other's surfaces (visibility consistency; Huber and Hebert, IVC 2003): what
comes into sight for the first time, as the end of a corridor, fits nothing in the right place, and might had the robot
not moved. Chosen on ACES, CSAIL and FHW with the laser cut to 4 m: the paths through them are 2.7, 0.9 and 0.4 m off
with that rule, 3.1, 4.3 and 1.6 m without.
"""

import numpy as np

from slamgym.core.portable import inverted
from slamgym.core.types import FloatArray
from slamgym.slam.graph.alignment import ALIGN_WIDTH, POINT_SHARE, Alignment, AlignmentTarget
from slamgym.slam.graph.matching import SearchWindow
from slamgym.slam.graph.relative import chi_squared, is_within, pose_spreads
from slamgym.slam.graph.sight import ScanView, Sight
from slamgym.slam.graph.submaps import OrientedPoints

GOOD_FIT = 0.8
"""An alignment of a smaller share of fitting points is compared with a search where the odometry may err."""
POOR_FIT = 0.5
"""An alignment of a smaller share of fitting points is compared with a search where the odometry may lie, too, and says
nothing of the size of the wheels' errors: else wheels that led the scans astray seem to be right, and are trusted more
and more. Chosen on ACES with every other beam, whose path was 3.7 m off and is 0.16 m; through FHW whole, to 8 m, to
4 m, with one of 2 and of 4 beams 0.144, 0.25, 0.44, 0.23, 0.61 m became 0.137, 0.21, 0.38, 0.15, 0.19; CSAIL to 4 m
1.22 became 1.37; homes stay."""
POINT_NATS = 0.5 * POINT_SHARE * ALIGN_WIDTH**2
"""Log-likelihood of a point that fits over one that doesn't [nats]."""
LIE_NATS = 9.2
"""Evidence that another place needs against odometry that may lie [nats]: it does once in 10,000 scans."""
SUSPICION_NATS = 60.0
"""Evidence that scans in a row need together against the odometry, where a place near the predicted one fits better
[nats]: one scan alone may see a new wall next to an old one."""
NARROW_SEARCH_NATS = 2.0
"""Evidence for a place that a search in a narrow window finds by chance, as it looks at so many [nats]."""
WIDE_SEARCH_NATS = 9.0
"""Evidence for a place that a search in the largest window finds by chance, as it looks at so many [nats]."""
LEAST_SCORE = 0.3
"""Score of a search below which nothing was found."""
WINDOW_DEVIATIONS = 6.0
"""A narrow window reaches so many standard deviations of the predicted pose from it."""
LEAST_WINDOW = (0.1, 0.05)
"""Smallest window of a search [m], [rad]: what lies within it, an alignment finds by itself."""
LARGEST_WINDOW = (1.0, 0.6)
"""Largest window of a search about the predicted pose [m], [rad]."""


class Recovery:
    """Judges alignments, and looks elsewhere where they are poor.

    Args:
        sight: Tells which points scans saw through.
    """

    def __init__(self, sight: Sight) -> None:
        self._sight = sight
        self.recovered = 0
        """How often another place was taken."""
        self._suspicion = 0.0  # against the odometry, of the scans since one fitted well

    def check(
        self,
        target: AlignmentTarget,
        scan: ScanView,
        predicted: FloatArray,
        known: FloatArray,
        placed: Alignment,
        before: ScanView,
        last: FloatArray,
    ) -> Alignment:
        """Search round the predicted pose for a place that explains a scan better than where it was aligned.

        Args:
            target: The submaps that it was aligned with.
            scan: The scan.
            predicted: (3,) pose by odometry.
            known: (3, 3) information of that.
            placed: Where the scan was aligned.
            before: The scan before.
            last: (3,) where that was taken: where the robot still is if its wheels turn in vain.

        Returns:
            The better place, or what was given.
        """
        if placed.fit >= GOOD_FIT:
            self._suspicion = 0.0
        deviations = WINDOW_DEVIATIONS * pose_spreads(inverted(known))
        narrow = np.clip(deviations, LEAST_WINDOW, LARGEST_WINDOW)
        for centre, is_wide in ((predicted, False), (predicted, True), (last, True)):
            if placed.fit >= (POOR_FIT if is_wide else GOOD_FIT):
                break
            window = np.array(LARGEST_WINDOW) if is_wide else narrow
            start = _search(target, scan.seen, centre, window)
            if start is None:
                continue
            other = target.align_freely(scan.seen, start)
            better = (other.fit - placed.fit) * len(scan.seen.points)
            explained = better
            if is_wide:
                explained = self._sight.clashes(scan, placed, before, last)
                explained -= self._sight.clashes(scan, other, before, last)
            gain = min(better, explained) * POINT_NATS
            gain -= WIDE_SEARCH_NATS if is_wide else NARROW_SEARCH_NATS
            self._suspicion += max(gain, 0.0)
            needed = LIE_NATS
            if not is_wide:
                needed = max(LIE_NATS, SUSPICION_NATS - self._suspicion)
            needed = min(0.5 * chi_squared(other.pose, predicted, known), needed)
            if gain > needed and is_within(other.pose, centre, window + LEAST_WINDOW):
                placed = other
                self.recovered += 1
        return placed


def _search(
    target: AlignmentTarget, seen: OrientedPoints, centre: FloatArray, window: FloatArray
) -> FloatArray | None:
    """Search a window (2,) [m], [rad] about a pose for a place to align a scan from; None if there is none."""
    if (window == LEAST_WINDOW).all():
        return centre
    space = SearchWindow(target, centre, window, seen.reach)
    place, score = space.search(seen, LEAST_SCORE)
    return place if score > LEAST_SCORE else None
