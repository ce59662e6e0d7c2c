"""Simulate a survey: two clouds of an invented slope with known change, to try SlopeWatch and to check it."""

from __future__ import annotations

from typing import ClassVar

from ..interface.command_list import BASIC
from ..interface.parameters import command_sets
from ..plugin.bridge.styling import Appearance
from . import products
from .simulation import SimulationAlgorithm

_PRODUCTS = (
    products.Product("ROI", "roi", "Region of interest", "Polygon of the cut face.", Appearance(20), layer="roi"),
    products.Product(
        "TRUTH_DZ",
        "truth_dz",
        "True elevation change (m)",
        "The change that was put into the later survey.",
        Appearance(10),
        by_default=False,
    ),
    products.Product(
        "TRUTH_MOTION",
        "truth_motion",
        "True motion (m)",
        "How far the ground of the first survey has moved east, north and up; written only with a motion along the "
        "surface.",
        Appearance(10),
        by_default=False,
    ),
    products.Product(
        "TRUTH_ZONES",
        "truth_zones",
        "Outlines of moved ground",
        "Where ground moved along the surface, with the vector of its middle; written only with such a motion.",
        Appearance(20),
        by_default=False,
        layer="motions",
    ),
)


class SimulateSurvey(SimulationAlgorithm):
    NAME = "simulatesurvey"
    TITLE = "Simulate a survey"
    SUMMARY = "Writes two simulated UAV LiDAR surveys of one cut slope with known change and offset."
    TAGS = (
        "simulation", "synthetic", "test data", "sample data", "truth", "demo", "tutorial",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.SIMULATE_SURVEY
    KIND = "survey"
    FOLDER_HELP = "Receives both surveys, the region of interest and the truth."
    BASIC = BASIC["simulate survey"]
    PRODUCTS = _PRODUCTS
    LAYERS = "SlopeWatch simulated survey"
    FILES: ClassVar = {
        "REFERENCE": ("reference", "First survey"),
        "CLOUD": ("cloud", "Later survey"),
        "TRUTH": ("truth", "Truth"),
        "TRUTH_TRANSFORM": ("truth_transform", "True transform"),
        "RUN_RECORD": ("run", "Run record"),
    }
