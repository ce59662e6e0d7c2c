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
    "Installation": ("check",),
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
