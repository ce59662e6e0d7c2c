"""SlopeWatch: change and hazards of road slopes from UAV LiDAR surveys."""


def classFactory(iface):  # noqa: N802 - the name QGIS calls
    """Called by QGIS to load the plugin; ``iface`` is None under qgis_process."""
    from .plugin.slopewatch_plugin import SlopeWatchPlugin

    return SlopeWatchPlugin(iface)
