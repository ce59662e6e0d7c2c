"""SlopeWatch: change and hazards of road slopes from UAV LiDAR surveys."""

from __future__ import annotations

import importlib
from typing import Any


def classFactory(iface: Any) -> Any:
    """Called by QGIS to load the plugin; ``iface`` is None under qgis_process."""
    from .plugin.slopewatch_plugin import SlopeWatchPlugin

    return SlopeWatchPlugin(iface)


def __getattr__(name: str) -> Any:
    """``slopewatch.api``, loaded on first use: QGIS's process imports this module and must not load the engine."""
    if name == "api":
        return importlib.import_module(".api", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
