"""The memory that a slope will need, from the headers of its clouds and its extent, before any work."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from shapely.geometry import box

from ...engine.core.errors import InputError
from ...engine.core.machine_memory import machine_memory
from ...engine.core.progress import Progress
from ...engine.grid.chosen_cell import CELL_SIDES_M
from ...engine.grid.common_grid import allowed, memory_needed
from ...engine.pointcloud.header import CloudHeader
from ...engine.pointcloud.reading import open_cloud
from ...engine.series.first_grid import held_whole
from ...engine.vector.area import read_roi
from ...interface.parameters import (
    AUTO,
    ChangeParameters,
    DisplacementStepParameters,
    GridChangeParameters,
    InputParameters,
    ParameterSet,
    ScreeningParameters,
)
from .jobs import Problem, Slope
from .planning import Plan
from .settings import INSPECT, group_of

# Measured peaks of whole trees of processes (lab/benchmarks/corridor.py prints the peak of its slopes).
_BYTES_TO_START = {INSPECT: 450_000_000, "series": 450_000_000}  # libraries and small surveys
_BYTES_OF_TORCH = 450_000_000  # the method `network` and own weights load it
_BYTES_A_POINT = 170  # of each survey whose ground is extracted at the same time
_MOTION_BYTES, _MOTION_BYTES_A_POINT = 300_000_000, 117
"""Of the motion along the surface: the surfaces of one tile, and each ground point (docs/displacement.md)."""
_SURVEYS_AT_ONCE = 2
_SHARE_OF_MACHINE = 0.5


def slope_memory(slope: Slope, command: str, groups: Mapping[type[ParameterSet], ParameterSet]) -> int:
    """Bytes that a slope's process and its children are estimated to need together.

    The clouds' points, all of them, and the grid over what the region leaves of their extents; a cell that is left to
    the clouds is taken to be their mean spacing. The motion along the surface is measured when the ground is extracted,
    so that the larger of both counts; all points are taken to be ground.

    Raises:
        InputError: a cloud or the region cannot be read.
    """
    inputs = next(g for g in groups.values() if isinstance(g, InputParameters))
    change = next(g for g in groups.values() if isinstance(g, GridChangeParameters))
    headers = [open_cloud(survey.cloud, inputs) for survey in slope.surveys]
    counts = sorted((header.count for header, _ in headers), reverse=True)
    points = sum(counts[:_SURVEYS_AT_ONCE])
    grid = 0.0
    if len(headers) > 1 and all(header.bounds_trusted for header, _ in headers):
        frame = headers[0][1]
        low, high = _extent([header for header, _ in headers], frame.horizontal_factor)
        area = float(np.prod(high - low))
        spacing = math.sqrt(area / max(1, counts[-1]))
        region = box(*low, *high)
        if slope.roi is not None:
            region = read_roi(slope.roi, frame.crs, unit=frame.horizontal_factor).geometry.intersection(region)
        if not region.is_empty and region.area > 0:
            west, south, east, north = region.bounds
            sized = _sized(change, spacing)
            sized = held_whole(sized) if command == "series" else sized
            grid = memory_needed((west, south, east, north), region.area, sized, plants=True)
            grid = min(grid, allowed(change))  # more is refused
    torch = any(
        isinstance(g, ScreeningParameters) and (g.screening_method == "network" or g.weights) for g in groups.values()
    )
    held = float(_BYTES_A_POINT * points)
    if len(headers) > 1 and any(isinstance(g, DisplacementStepParameters) and g.displacement for g in groups.values()):
        held = max(held, motion_memory(points))
    return int(_BYTES_TO_START[command] + _BYTES_OF_TORCH * torch + held + grid)


def motion_memory(points: int) -> int:
    """Bytes that the motion along the surface takes between two surveys of so many ground points together."""
    return _MOTION_BYTES + _MOTION_BYTES_A_POINT * points


def memory_needs(found: Plan, progress: Progress) -> dict[str, int]:
    """``slope_memory`` of the slopes that are to be worked on, by name; what cannot be read is one more problem."""
    needs = {}
    for number, slope in enumerate(found.waiting):
        progress.update(number / len(found.waiting), f"reading the headers of {slope.name}")
        job = found.jobs[slope.name]
        try:
            groups = group_of(job.command, job.options, job.profile)
            needs[slope.name] = slope_memory(slope, job.command, groups)
        except InputError as error:
            found.problems.append(Problem(slope.name, str(error)))
    return needs


def _extent(headers: list[CloudHeader], factor: float) -> tuple[np.ndarray, np.ndarray]:
    low = np.min([header.bounds_low[:2] for header in headers], axis=0) * factor
    high = np.max([header.bounds_high[:2] for header in headers], axis=0) * factor
    return low, np.maximum(high, low)


def _sized(change: GridChangeParameters, spacing: float) -> GridChangeParameters:
    """The parameters with a cell: the given one, or about the spacing where that is left to the clouds."""
    if change.cell != AUTO:
        return change
    cell = next((side for side in CELL_SIDES_M if side >= spacing), CELL_SIDES_M[-1])
    kind = ChangeParameters if isinstance(change, ChangeParameters) else GridChangeParameters
    return replace(kind(**change.__dict__), cell=cell)


def default_budget(memory: int | None) -> int:
    """Bytes of the budget: ``memory`` of a cluster as it says itself, else half of this machine's."""
    return memory if memory is not None else int(_SHARE_OF_MACHINE * machine_memory())
