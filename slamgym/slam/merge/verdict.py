"""Whether two maps belong together: how probable their agreement is by chance, and whether another place fits as well.

Each metre of wall that both maps saw lies on a wall of the other, beside one, or on free floor. How often it does so in
maps of one building, and at the best place for maps of different ones, was counted; the logarithm of the ratio of these
shares, summed over all metres, is the evidence. By chance the best of all places for maps of different buildings has a
few nats; a joint that is called sure has more, and no other place comes near.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgym.core.types import FloatArray
from slamgym.slam.merge.joint import Joint
from slamgym.slam.merge.overlay import Agreement

AGREED_NATS = 0.19
"""Evidence of a metre of wall on wall [nats]."""
BESIDE_NATS = 1.9
"""Evidence against of a metre of wall beside a wall [nats]."""
CONTRADICTED_NATS = 1.9
"""Evidence against of a metre of wall on free floor [nats]."""
SURE_NATS = 4.5
"""A joint is sure if it has so much evidence ..."""
MARGIN_NATS = 3.0
"""... and so much more than any other place."""


def evidence_of(agreement: Agreement) -> float:
    """Evidence that two maps show one building at a place [nats]."""
    agreed, beside, contradicted = agreement
    return AGREED_NATS * agreed - BESIDE_NATS * beside - CONTRADICTED_NATS * contradicted


class Hypothesis(NamedTuple):
    """A way in which two maps may lie."""

    pose: FloatArray  # (3,) of the second one's frame in the first's
    agreement: Agreement
    joint: Joint | None  # None: of a picture, or no submap can be aligned there
    covariance: FloatArray  # (3, 3) of the pose as the walls bind it

    @property
    def evidence(self) -> float:
        """That they show one building [nats]."""
        return evidence_of(self.agreement)


class Verdict(NamedTuple):
    """The best way, and what speaks against it."""

    best: Hypothesis | None  # None: nothing of one is seen on the other
    rival: float  # evidence of the best other place [nats]
    doubt: str  # why it isn't sure; empty if it is


def judge(hypotheses: Sequence[Hypothesis]) -> Verdict:
    """Judge some ways in which two maps may lie, each clearly different from the others."""
    ranked = sorted(hypotheses, key=lambda hypothesis: -hypothesis.evidence)
    if not ranked:
        return Verdict(None, -np.inf, "nothing that one shows is seen on the other")
    best = ranked[0]
    rival = max((other.evidence for other in ranked[1:]), default=-np.inf)
    agreed = best.agreement.agreed
    against = best.agreement.beside + best.agreement.contradicted
    doubt = ""
    if best.evidence < SURE_NATS:
        doubt = (
            f"at the best place {agreed:.0f} m of wall agree and {against:.0f} m contradict, as may be by chance in "
            "different buildings"
        )
    elif best.evidence - rival < MARGIN_NATS:
        doubt = f"{agreed:.0f} m of wall agree at the best place, but another fits about as well"
    return Verdict(best, rival, doubt)
