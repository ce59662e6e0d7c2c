"""Fields and actions of a file of corrections by hand."""

from __future__ import annotations

EXCLUDE, GROUND, NOT_GROUND = "exclude", "ground", "not_ground"
ACTIONS = (EXCLUDE, GROUND, NOT_GROUND)
"""Left out of the comparison; the lowest returns are ground; no return is ground."""
ACTION, REASON, EPOCH = "action", "reason", "epoch"
"""Fields: one of the actions; why, in words; the date of the one survey that it holds for, empty for all."""
FILE = "corrections.gpkg"
"""Name of the file beside a run's results that the panel keeps."""
LABELS = {EXCLUDE: "excluded from the comparison", GROUND: "lowest returns are ground", NOT_GROUND: "no ground"}
"""Names of the actions, for reports."""
