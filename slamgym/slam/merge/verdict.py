"""Whether two maps belong together: how probable their agreement is by chance, and whether another place fits as well.

Each metre of wall that both maps saw lies on a wall of the other or in its open floor, where maps that only bend have
none. How often it does so in maps of one building, and at the best place for maps of different ones, was counted; the
logarithm of the ratio of these shares, summed over all metres, is the evidence. By chance the best of all places for
maps of different buildings has little; a joint that is called sure has more, and no other place comes near.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgym.core.types import FloatArray, Pose2D
from slamgym.slam.merge.joint import Joint
from slamgym.slam.merge.overlay import WallAgreement


class Odds(NamedTuple):
    """What metres of wall say, and how much is enough."""

    agreed: float  # evidence of a metre of wall on wall [nats]
    contradicted: float  # evidence against of a metre of wall in open floor [nats]
    moved: float  # of a metre of what else stands there [nats]
    unmoved: float  # of a metre of wall there that no moved furniture explains, beyond that [nats]
    sure: float  # a joint is sure with so much evidence [nats] ...
    margin: float  # ... and so much more than any other place has

    def evidence(self, agreement: WallAgreement) -> float:
        """Evidence that two maps show one building at a place [nats]."""
        agreed, contradicted, moved, in_line = agreement
        unmoved = max(in_line, contradicted - WALLS_OF_HEAPS * moved)
        against = self.contradicted * contradicted + self.moved * moved + self.unmoved * unmoved
        return self.agreed * agreed - against

    def bound(self, agreement: WallAgreement) -> float:
        """The most that this can be, if all that stands in open floor was moved [nats]."""
        agreed, contradicted, moved, _ = agreement
        return self.evidence(WallAgreement(agreed, 0.0, contradicted + moved))


WALLS_OF_HEAPS = 3.0
"""Furniture that was moved looks at most so many times as much like walls as like heaps: 2.4 times in 13 homes and on
29 days. Without, twice as many wrong pairs would be sure."""
UNKNOWN_BUILDINGS = Odds(0.16, contradicted=15.0, moved=1.0, unmoved=0.0, sure=5.5, margin=3.0)
"""Nothing is known of two maps: they may be of storeys of the same rooms. A wall in the other map's open floor is a
door that only one of them has. In 27 buildings the right places have 7.9 nats and more but for one (3.5), mirror
images, storeys and other buildings 2.7 at most: what is sure lies between. Without what was moved one storey would have
8.5. Both halves of Freiburg 079 keep 13."""
SAME_BUILDING = Odds(0.16, contradicted=0.25, moved=0.25, unmoved=5.0, sure=5.5, margin=3.0)
"""Someone says that both are of one building: furniture may have been moved, but leaves heaps, and doors stay where
they are, opened or closed. Chosen on half of 35 buildings and 29 days of one home: 3 of 51 wrong pairs are sure there
(16 if nothing were unmoved), 1 of 54 in the other half (20). With 10 nats days and homes with closed doors are refused;
with 4 nats 6 wrong pairs are sure."""


class Overlay(NamedTuple):
    """A way in which two maps may lie."""

    pose: FloatArray  # (3,) of the second one's frame in the first's
    covariance: FloatArray  # (3, 3) of that as the walls bind it
    agreement: WallAgreement
    evidence: float  # that they show one building [nats]
    joint: Joint | None = None  # None: of a picture, or no submap can be aligned there


class JointVerdict(NamedTuple):
    """The best way, and what speaks against it."""

    best: Overlay | None  # None: nothing of one is seen on the other
    rival: float  # evidence of the best other place [nats]
    doubt: str  # why it isn't sure; empty if it is

    @property
    def place(self) -> Pose2D | None:
        """Where the second map lies on the first; None if that isn't sure."""
        return None if self.best is None or self.doubt else Pose2D(*self.best.pose.tolist())


def judge_joint(hypotheses: Sequence[Overlay], odds: Odds) -> JointVerdict:
    """Judge some ways in which two maps may lie, each clearly different from the others."""
    ranked = sorted(hypotheses, key=lambda hypothesis: -hypothesis.evidence)
    if not ranked:
        return JointVerdict(None, -np.inf, "nothing that one shows is seen on the other")
    best = ranked[0]
    rival = max((other.evidence for other in ranked[1:]), default=-np.inf)
    agreed, contradicted = best.agreement[:2]
    doubt = ""
    if best.evidence < odds.sure:
        doubt = f"at the best place {agreed:.0f} m of wall agree and {contradicted:.1f} m contradict, as by chance"
    elif best.evidence - rival < odds.margin:
        doubt = f"{agreed:.0f} m of wall agree at the best place, but another fits about as well"
    return JointVerdict(best, rival, doubt)
