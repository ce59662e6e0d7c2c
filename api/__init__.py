"""The public Python API: the commands of SlopeWatch as functions. Only the names in ``__all__`` are promised.

Each function takes paths, writes the files of the command of that name, and returns their paths and the figures.
Parameters are the options of the command line with underscores (``cell=0.2``, ``cloth_resolution=0.3``,
``screen_last_epoch=False``); docs/guide.md explains them. An unknown name is refused.

Examples
--------
>>> from slopewatch import api
>>> run = api.inspect({"2024-05-01": "may24.laz", "2025-05-01": "may25.laz"}, "results", roi="slope.gpkg")
>>> run.outputs["zones"], run.figures["zone_count"]
"""

from __future__ import annotations

from ..engine.core.errors import Cancelled, EngineError, InputError, SlopeWatchError
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from .drawing import export_label_studio, import_label_studio, locate, suggest_roi, top_view
from .flight import compare_flight, plan_flight
from .flow import batch, extract_ground, inspect, monitor, screen
from .handover import create_project, export_gis, report
from .pairs import change, dem_change, displacement, m3c2, register
from .simulation import simulate

__all__ = [
    "Cancelled",
    "EngineError",
    "InputError",
    "Progress",
    "RunResult",
    "SlopeWatchError",
    "batch",
    "change",
    "compare_flight",
    "create_project",
    "dem_change",
    "displacement",
    "export_gis",
    "export_label_studio",
    "extract_ground",
    "import_label_studio",
    "inspect",
    "locate",
    "m3c2",
    "monitor",
    "plan_flight",
    "register",
    "report",
    "screen",
    "simulate",
    "suggest_roi",
    "top_view",
]
