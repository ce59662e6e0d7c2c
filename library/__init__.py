"""The engine on points in memory: arrays, laspy clouds or files in, objects out, nothing on the disk until ``write``.

Each function is loaded when it is first asked for, as ``slopewatch.NAME``.

Examples
--------
>>> import laspy, slopewatch
>>> first, later = (slopewatch.ground(laspy.read(path)) for path in ("2024-05-01.laz", "2025-05-01.laz"))
>>> moved = slopewatch.register(first, later)
>>> found = slopewatch.change(first, moved, dates=("2024-05-01", "2025-05-01"))
>>> found.zones[["zone_id", "vol_net_m3", "vol_err_m3"]]
>>> found.plot()
>>> found.write("results")
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .bare_ground import Ground, ground
    from .distances import M3C2Distances, m3c2
    from .elevation_change import ElevationChange, change
    from .motion import Motion, displacement
    from .registration import Registration, register
    from .screening import Screened, screen
    from .time_series import Series, series

_PLACES = {
    "bare_ground": ("Ground", "ground"),
    "distances": ("M3C2Distances", "m3c2"),
    "elevation_change": ("ElevationChange", "change"),
    "motion": ("Motion", "displacement"),
    "registration": ("Registration", "register"),
    "screening": ("Screened", "screen"),
    "time_series": ("Series", "series"),
}
_MODULES = {name: module for module, names in _PLACES.items() for name in names}
__all__ = [
    "ElevationChange",
    "Ground",
    "M3C2Distances",
    "Motion",
    "Registration",
    "Screened",
    "Series",
    "change",
    "displacement",
    "ground",
    "m3c2",
    "register",
    "screen",
    "series",
]


def __getattr__(name: str) -> Any:
    """A function or the class of its result."""
    if name in _MODULES:
        return getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
