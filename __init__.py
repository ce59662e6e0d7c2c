"""SlopeWatch: change and hazards of road slopes from UAV LiDAR surveys."""

from __future__ import annotations

import importlib
from typing import Any

LIBRARY = ("change", "displacement", "ground", "m3c2", "register", "screen", "series")
"""Functions on points in memory."""


def classFactory(iface: Any) -> Any:
    """Called by QGIS to load the plugin; ``iface`` is None under qgis_process."""
    from .plugin.slopewatch_plugin import SlopeWatchPlugin

    return SlopeWatchPlugin(iface)


def __getattr__(name: str) -> Any:
    """``slopewatch.api`` and the library, loaded on first use: QGIS's process must not load the engine."""
    if name == "api":
        return importlib.import_module(".api", __name__)
    if name in LIBRARY:
        return getattr(importlib.import_module(".library", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
