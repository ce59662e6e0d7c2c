"""When and how each return of a cloud was measured: strip, time and scan angle."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.arrays import Float, Index
from .header import preflight
from .records import read_records

_ANGLE_STEP_DEG = 0.006  # of a scan angle in point formats 6 and above (LAS 1.4 R15)

LARGEST_TIME_S = 1e12
"""GPS seconds of either kind stay below it for thousands of years; what lies beyond is damage."""


@dataclass(frozen=True)
class Flown:
    """Of each return, in the file's order: ``source`` (n,) its strip's number; ``seconds`` (n,) when, None where the
    point format has no time, all are alike or one is no time; ``angle`` (n,) degrees from the vertical, positive to the
    right of the flight.
    """

    source: Index
    seconds: Float | None
    angle: Float


def read_flown(path: Path | str) -> Flown:
    """Strips, times and scan angles of all returns.

    Raises:
        InputError: see ``preflight`` and ``read_records``.
    """
    source, seconds, angle = [], [], []
    for records in read_records(preflight(path)):
        names = records.array.dtype.names or ()
        source.append(np.array(records["point_source_id"], dtype=np.int64))
        seconds.append(np.array(records["gps_time"], dtype=np.float64) if "gps_time" in names else np.empty(0))
        fine = "scan_angle" in names
        found = np.array(records["scan_angle" if fine else "scan_angle_rank"], dtype=np.float64)
        angle.append(found * _ANGLE_STEP_DEG if fine else found)
    times = np.concatenate([np.empty(0), *seconds])
    known = len(times) > 0 and bool((np.abs(times) < LARGEST_TIME_S).all()) and bool(np.ptp(times) > 0)
    return Flown(
        np.concatenate([np.empty(0, np.int64), *source]),
        times if known else None,
        np.concatenate([np.empty(0), *angle]),
    )
