"""Simulate scenes: slopes of one epoch whose every point has a known class, to train on and to score with."""

from __future__ import annotations

from typing import ClassVar

from ..interface.parameters import command_sets
from .simulation import SimulationAlgorithm


class SimulateScenes(SimulationAlgorithm):
    NAME = "simulatescenes"
    TITLE = "Simulate labelled scenes"
    SUMMARY = "Writes simulated slopes with bulges, hollows and what looks like them, the class of every point known."
    TAGS = (
        "simulation", "synthetic", "labels", "truth", "training data", "hazard", "benchmark",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.SIMULATE_SCENES
    KIND = "scenes"
    FOLDER_HELP = "Receives the scenes, their hazards, a picture and a manifest."
    FILES: ClassVar = {
        "SCENE": ("scene", "First scene"),
        "HAZARDS": ("hazards", "Hazards"),
        "MANIFEST": ("manifest", "Manifest"),
        "PICTURE_FILE": ("picture", "Picture"),
        "RUN_RECORD": ("run", "Run record"),
    }
    NUMBERS: ClassVar = {
        "SCENES": ("scenes", "Scenes"),
        "POINTS": ("points", "Points"),
        "HAZARD_COUNT": ("hazards", "Hazards"),
        "SHARE_BACKGROUND": ("share_background", "Share of background (0 to 1)"),
        "SHARE_UPLIFT": ("share_uplift", "Share of uplift (0 to 1)"),
        "SHARE_SUBSIDENCE": ("share_subsidence", "Share of subsidence (0 to 1)"),
    }
