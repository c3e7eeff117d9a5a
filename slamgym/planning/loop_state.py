"""States of the exploration loop, and the events that lead from one to another."""

import enum
from collections.abc import Mapping


class LoopState(enum.Enum):
    """State of an exploration loop."""

    SEARCHING = "searching"
    """The candidates are searched as soon as the robot stands without a goal."""
    WAITING = "waiting"
    """There is nothing to choose; the candidates are searched again on a newer map."""
    CHOOSING = "choosing"
    """One of the candidates is to be chosen; a robot that has a target goes on driving there meanwhile."""
    DRIVING = "driving"
    """The robot drives to the chosen frontier."""
    FINISHED = "finished"
    """Nothing is left to explore, or the promise is kept."""


class LoopEvent(enum.Enum):
    """Event that leads an exploration loop to a state."""

    OFFERED = "candidates were found"
    NOTHING_FOUND = "no candidate was found"
    CHOSEN = "a candidate was chosen, and a path leads there"
    GOAL_ENDED = "a goal was reached or given up, or no path leads to any candidate"
    RECOVERING = "a recovery behaviour was begun"
    LOOKING_AGAIN = "before the end the robot looks at a way that somebody may have closed"
    CORRECTED = "the map was corrected, and the newest one is still the old one"
    ENDED = "everything was tried, or what is left is worth no visit"
    FORGIVEN = "what was given up is offered again"


_STATE_AFTER: Mapping[LoopEvent, LoopState] = {
    LoopEvent.OFFERED: LoopState.CHOOSING,
    LoopEvent.NOTHING_FOUND: LoopState.WAITING,
    LoopEvent.CHOSEN: LoopState.DRIVING,
    LoopEvent.GOAL_ENDED: LoopState.SEARCHING,
    LoopEvent.RECOVERING: LoopState.SEARCHING,
    LoopEvent.LOOKING_AGAIN: LoopState.WAITING,
    LoopEvent.CORRECTED: LoopState.WAITING,
    LoopEvent.ENDED: LoopState.FINISHED,
    LoopEvent.FORGIVEN: LoopState.SEARCHING,
}
"""The state that each event leads to, from whichever state but the end."""

_GOES_ON = (LoopEvent.LOOKING_AGAIN, LoopEvent.FORGIVEN)
"""Only these events lead on from the end; the others leave it as it is."""


def next_state(state: LoopState, event: LoopEvent) -> LoopState:
    """The state that an event leads to."""
    if state is LoopState.FINISHED and event not in _GOES_ON:
        return state
    return _STATE_AFTER[event]
