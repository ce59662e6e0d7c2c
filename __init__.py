"""SlopeWatch: change and hazards of road slopes from UAV LiDAR surveys."""

from __future__ import annotations

from typing import Any


def classFactory(iface: Any) -> Any:
    """Called by QGIS to load the plugin; ``iface`` is None under qgis_process."""
    from .plugin.slopewatch_plugin import SlopeWatchPlugin

    return SlopeWatchPlugin(iface)
