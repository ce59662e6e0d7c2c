"""The commands by what users do, in the order in which ``slopewatch --help`` shows them."""

from __future__ import annotations

COMMANDS: dict[str, tuple[str, ...]] = {
    "Inspect slopes": ("inspect", "series", "batch", "screen"),
    "Single steps": ("ground", "register", "change", "m3c2", "displacement", "demchange", "locate", "report"),
    "Hand over": ("exportgis", "createproject"),
    "Look at clouds, draw and label": (
        "info", "topview", "suggestroi", "exportlabelstudio", "importlabelstudio",
    ),
    "Plan the next survey": ("planflight", "compareflight"),
    "Try and train": ("simulate", "train"),
    "Installation and settings": ("check", "parameters"),
}  # fmt: skip
OTHERS = "Other commands"
"""Heading of commands that are not listed."""

TITLES = {
    "inspect": "Inspect slope",
    "series": "Inspect series",
    "batch": "Inspect corridor",
    "screen": "Screen for hazards",
    "ground": "Extract ground",
    "register": "Register epochs",
    "change": "Elevation change",
    "m3c2": "M3C2 distances",
    "displacement": "Displacement vectors",
    "demchange": "Change of elevation models",
    "locate": "Locate on the road",
    "report": "Write report",
    "exportgis": "Export to GIS and CAD",
    "createproject": "Create project",
    "topview": "Top view",
    "suggestroi": "Suggest a region of interest",
    "planflight": "Plan a flight",
    "compareflight": "Compare a flight with its plan",
    "exportlabelstudio": "Export to Label Studio",
    "importlabelstudio": "Import from Label Studio",
    "simulate survey": "Simulate a survey",
    "simulate series": "Simulate a series",
    "simulate scenes": "Simulate labelled scenes",
    "train": "Train a model",
    "check": "Check environment",
    "info": "Cloud information",
}
"""The commands' titles in the toolbox, for sentences that name a command."""

BASIC: dict[str, tuple[str, ...]] = {
    "batch": ("workers", "two_surveys", "cell", "minimum_area", "overwrite"),
    "demchange": ("cell", "plan_shift", "tilt", "statistics_only", "minimum_area", "overwrite"),
    "displacement": ("ground", "window", "largest_motion", "overwrite"),
    "change": ("ground", "cell", "minimum_area", "overwrite"),
    "series": ("ground", "rasters_each_survey", "cell", "minimum_area", "overwrite"),
    "inspect": ("cell", "minimum_area", "screen_last_epoch", "overwrite"),
    "locate": ("chainage_start", "chainage_direction", "chainage_unit", "chainage_style", "route_name", "overwrite"),
    "m3c2": ("ground", "normal_scale", "projection_scale"),
    "planflight": ("altitude", "flying_speed", "field_of_view", "side_overlap", "pulse_rate", "scan_pattern"),
    "screen": (
        "screening_method", "ground", "minimum_probability", "minimum_hazard_area", "probability_cell",
        "false_zones", "self_test",
    ),
    "simulate series": (
        "seed", "points", "length", "height", "surveys", "interval", "velocities", "motion", "onset",
        "overwrite",
    ),
    "simulate survey": (
        "seed", "points", "length", "height", "angle", "vegetation", "amplitude", "motion", "grass",
        "overwrite",
    ),
    "train": ("start", "dimension", "classes", "class_field", "steps", "minutes", "folds", "overwrite"),
    "report": ("zone_profiles", "pdf", "slope_name", "report_route", "client", "author", "checker"),
}  # fmt: skip
"""The parameters that ``--help`` and dialogs show at first, by command; of others those that are not advanced."""
