"""Why a window has a motion, or none."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """What became of a window; only ``MEASURED`` has a vector."""

    MEASURED = 0
    NO_GROUND = 1
    LITTLE_SEEN = 2
    NO_RELIEF = 3
    RELIEF_ONE_WAY = 4
    NOT_RIGID = 5
    NOT_FOUND = 6
    UNCERTAIN = 7


REASONS = {
    Status.MEASURED: "measured",
    Status.NO_GROUND: "no ground points",
    Status.LITTLE_SEEN: "too little of it is seen in both surveys",
    Status.NO_RELIEF: "no relief that both surveys share",
    Status.RELIEF_ONE_WAY: "relief holds it in one direction only",
    Status.NOT_RIGID: "the surfaces do not fit on each other: objects came or went, or the ground changed its shape",
    Status.NOT_FOUND: "no motion found within the search",
    Status.UNCERTAIN: "standard error too large",
}
