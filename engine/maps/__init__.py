"""Pictures and QGIS styles."""
