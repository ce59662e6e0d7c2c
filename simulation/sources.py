"""What an echo is of."""

from __future__ import annotations

GROUND, TURF, LEAVES, MULTIPATH, STRAY = 0, 1, 2, 3, 4
"""TURF is all grass, mown or not, and what lies on the ground."""
