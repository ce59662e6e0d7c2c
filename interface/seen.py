"""Classes of ``seen.tif``: which parts of a slope two surveys compared, and why the rest was not compared."""

from __future__ import annotations

OUTSIDE, COMPARED, NOT_IN_FIRST, NOT_IN_LATER, NOT_IN_BOTH, TOO_FEW, EXCLUDED = range(7)
"""Values of the cells. Every cell has one; the raster (Uint8) has no cell without a value."""
NODATA = 255
NOT_SEEN: tuple[int, ...] = (NOT_IN_FIRST, NOT_IN_LATER, NOT_IN_BOTH, TOO_FEW, EXCLUDED)
"""Classes of the slope that were not compared."""
REACH_M = 1.0
"""A cell sees a survey's ground within the cell itself or within this distance of its centre, m."""
MIN_SEEN_SHARE = 0.3
"""A slope of which less was compared is named as such."""
RASTER = "seen.tif"

LABELS = {
    OUTSIDE: "Outside the slope",
    COMPARED: "Compared",
    NOT_IN_FIRST: "Not seen: no ground in the first survey",
    NOT_IN_LATER: "Not seen: no ground in the later survey",
    NOT_IN_BOTH: "Not seen: no ground in both surveys",
    TOO_FEW: "Not seen: too few ground points",
    EXCLUDED: "Excluded by hand",
}
"""Names of the classes, for legends."""
KEYS = {
    OUTSIDE: "outside",
    COMPARED: "compared",
    NOT_IN_FIRST: "not_in_first",
    NOT_IN_LATER: "not_in_later",
    NOT_IN_BOTH: "not_in_both",
    TOO_FEW: "too_few",
    EXCLUDED: "excluded",
}
"""Names of the classes in run.json and in tables."""
