"""Simulate a series: dated clouds of an invented slope with creeping zones, to try an inspection of a series on."""

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
        "TRUTH_VELOCITY",
        "truth_velocity",
        "True velocity (mm/day)",
        "The velocity that was put into the surveys, as an inspection of the series should find it: vertical, or "
        "with a motion along the surface east, north and up.",
        Appearance(10),
        by_default=False,
    ),
)


class SimulateSeries(SimulationAlgorithm):
    NAME = "simulateseries"
    TITLE = "Simulate a series"
    SUMMARY = "Writes dated simulated surveys of one cut slope, of which zones creep at known velocities."
    TAGS = (
        "simulation", "synthetic", "test data", "sample data", "truth", "creep", "velocity", "time series", "demo",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.SIMULATE_SERIES
    KIND = "series"
    FOLDER_HELP = "Receives the surveys, a manifest, the region of interest and the truth."
    BASIC = BASIC["simulate series"]
    PRODUCTS = _PRODUCTS
    LAYERS = "SlopeWatch simulated series"
    FILES: ClassVar = {
        "MANIFEST": ("manifest", "Manifest"),
        "TRUTH": ("truth", "Truth"),
        "RUN_RECORD": ("run", "Run record"),
    }
