"""What QGIS's process and the engine's must agree on. Standard library only, Python 3.9."""
