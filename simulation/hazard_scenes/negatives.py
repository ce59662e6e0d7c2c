"""What looks like a hazard and is none: the identifiers that every point of a scene carries."""

from __future__ import annotations

from enum import IntEnum


class Negative(IntEnum):
    """Type of the hard negative at a point; where two meet, the one built later counts."""

    NONE = 0
    DRAIN = 1
    DITCH = 2
    BEAM = 3
    BENCH_EDGE = 4
    RILL = 5
    GULLY = 6
    STEP = 7
    BOULDER = 8
    SPOIL = 9
    STUMP = 10
    SEAM = 11
    RESIDUE = 12
    STAIRS = 13
    PIPE = 14
    TERRACETTE = 15
    FACET = 16
