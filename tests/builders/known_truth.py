"""What known_changes.py puts into its files; apart from it, as QGIS's Python has no rasterio and laspy."""

from __future__ import annotations

DAYS = ("2024-05-01", "2025-05-01")

BIAS_M = 0.4
"""The later elevation model lies higher by this."""
PIT_M = -1.2
PIT_SIZE_M = 20
PIT_WEST_NORTH_M = (40, 50)
"""The pit's corner, from that of the models."""
MODEL_SIZE_M = 120

MOTION_M = 0.15
"""The northern half of the later cloud moved by this down the dip, which is to the east."""
DIP_DEG = 35.0
CLOUD_SIZE_M = 20.0
