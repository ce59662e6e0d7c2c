"""Cells that grow compared with cells of one size: how much is compared, how much change is seen, and how well."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from matplotlib.patches import Patch

from ...engine.change.difference import Areas, cells_inside, difference
from ...engine.change.result import Change
from ...engine.grid.grid import cell_index
from ...engine.maps.palette import diverging_colours, sequential_steps
from ...engine.zones.groups import label_groups
from ...interface.parameters import ChangeParameters, SurveyParameters, ZoneParameters
from ...simulation.surveys.survey import SimulatedPair, simulate_pair
from .chain import registered_clouds
from .table import Row, say

VEGETATION = (0.0, 0.4, 0.8)
SEEDS = (1, 2, 3)
SIZES = (0.1, 0.4, 0.8)
"""Cells of one size that are compared with, m."""
CHANGED, UNCHANGED = 0.05, 0.002
"""True change (m) from which ground has changed, and up to which it has not."""
STILL = 0.005


@dataclass(frozen=True)
class Result:
    """One difference of one pair, on the same cells of 0.1 m of the slope.

    Shares of the slope's area compared, of the changed area seen (beyond the level, with its sign) and of the compared
    unchanged area beyond the level; rms of measured minus true change (m); rms of that in stated errors, each block or
    cell once, against the true mean of its own cells; median level (m). ``false_zones`` is the number of zones in which
    nothing moved by more than ``STILL``.
    """

    compared: float
    seen: float
    false: float
    false_zones: float
    rmse: float
    in_errors: float
    level: float


def compare(change: Change, fine: Change, truth: np.ndarray, slope: np.ndarray) -> Result:
    """Figures of ``change`` on the grid of ``fine``, on which ``truth`` and the ``slope``'s cells are given."""
    grid = fine.grid
    x = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell
    y = grid.north - (np.arange(grid.rows) + 0.5) * grid.cell
    centres = np.stack([part.ravel() for part in np.meshgrid(x, y)], axis=1)
    at = cell_index(centres, change.grid)
    within = (at >= 0).reshape(grid.shape)

    def values(array: np.ndarray) -> np.ndarray:
        return np.where(within, array.ravel()[at].reshape(grid.shape), np.nan)

    dz, error, significant = values(change.dz), values(change.error), values(change.significant) == 1
    known = np.isfinite(dz) & slope
    changed = slope & (np.abs(truth) >= CHANGED)
    # each block, or cell of the coarser grid, once
    unit = change.partition.number.ravel()[at]
    unit = unit.reshape(grid.shape)[known]
    cells = np.bincount(unit)
    once = cells > 0
    mean = [np.bincount(unit, array[known])[once] / cells[once] for array in (dz, truth, error)]
    still = known & (np.abs(truth) <= UNCHANGED)
    labels = label_groups(change.dz, change.significant, ZoneParameters(), change.partition)
    moved = labels.ravel()[at[(within & (np.abs(truth) > STILL)).ravel()]]
    return Result(
        compared=float(known.sum() / slope.sum()),
        seen=float((significant & changed & (dz * truth > 0)).sum() / changed.sum()),
        false=float(significant[still].mean()),
        false_zones=float(labels.max() - len(np.setdiff1d(moved, [0]))),
        rmse=float(np.sqrt(np.mean((dz - truth)[known] ** 2))),
        in_errors=float(np.sqrt(np.mean(((mean[0] - mean[1]) / mean[2]) ** 2))),
        level=float(np.median(values(change.level)[known])),
    )


def results(pair: SimulatedPair) -> dict[str, Result]:
    """The pair's figures by the kind of cells."""
    first, second, error = registered_clouds(pair)
    area = shapely.Polygon(pair.roi)
    changes = {
        f"{cell:g} m": difference(
            first, second, ChangeParameters(cell=cell, adaptive=False), registration_error=error, areas=Areas(area)
        )
        for cell in SIZES
    }
    growing = ChangeParameters(adaptive=True)
    changes["growing"] = difference(first, second, growing, registration_error=error, areas=Areas(area))
    fine = changes["growing"]
    truth = pair.true_change_raster(fine.grid, subsamples=8)
    slope = cells_inside(area, fine.grid)
    return {name: compare(change, fine, truth, slope) for name, change in changes.items()}


def rows() -> list[Row]:
    """Means over ``SEEDS`` for each cover of vegetation."""
    table: list[Row] = []
    for vegetation in VEGETATION:
        found = []
        for seed in SEEDS:
            say(f"vegetation {vegetation:.0%}, seed {seed}")
            found.append(results(simulate_pair(_survey(vegetation, seed))))
        table += [_row(found, vegetation, *figure) for figure in FIGURES]
    return table


FIGURES = (
    ("slope compared", "compared", "{:.1f} %", 100.0),
    ("changed area seen", "seen", "{:.1f} %", 100.0),
    ("rms error of the change", "rmse", "{:.1f} mm", 1000.0),
    ("rms error in stated errors", "in_errors", "{:.2f}", 1.0),
    ("unchanged area beyond the level", "false", "{:.1f} %", 100.0),
    ("false zones a slope", "false_zones", "{:.2f}", 1.0),
    ("median level of detection", "level", "{:.1f} mm", 1000.0),
)
"""Name, field of ``Result``, format and scale."""


def _survey(vegetation: float, seed: int) -> SurveyParameters:
    return SurveyParameters(seed=seed, points=80_000, length=30.0, height=12.0, vegetation=vegetation)


def _row(found: list[dict[str, Result]], vegetation: float, figure: str, field: str, text: str, scale: float) -> Row:
    values = {kind: text.format(scale * np.mean([getattr(pair[kind], field) for pair in found])) for kind in found[0]}
    growing = values.pop("growing")
    others = ", ".join(f"{kind} {value}" for kind, value in values.items())
    name = f"{100 * vegetation:.0f} % vegetation: {figure}"
    if field != "false":
        return Row(name, growing, "", f"cells of {others}")
    met = 0.03 <= np.mean([pair["growing"].false for pair in found]) <= 0.07
    return Row(name, growing, "3 to 7 %", f"cells of {others}", bool(met))


def picture(path: Path, vegetation: float = 0.8, seed: int = 2) -> None:
    """Draw the truth, the change by cells of one size and by cells that grow, and the size of these, as a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    pair = simulate_pair(_survey(vegetation, seed))
    first, second, error = registered_clouds(pair)
    area = shapely.Polygon(pair.roi)
    fixed, grown = (
        difference(first, second, ChangeParameters(adaptive=adaptive), registration_error=error, areas=Areas(area))
        for adaptive in (False, True)
    )
    grid = grown.grid
    truth = np.where(cells_inside(area, grid), pair.true_change_raster(grid, subsamples=4), np.nan)
    limit = 0.3
    west, south, east, north = grid.bounds
    panels = [
        ("true change", truth),
        (f"cells of {fixed.grid.cell:g} m", fixed.dz),
        ("cells that grow", grown.dz),
        ("cells that grow, beyond the level", np.where(grown.significant, grown.dz, np.nan)),
    ]
    figure = Figure(figsize=(12, 7.4), dpi=90, layout="constrained")
    axes = figure.subplots(2, 3).ravel()
    extent = (0.0, east - west, 0.0, north - south)
    for axis, (title, dz) in zip(axes, panels, strict=False):
        rgb = diverging_colours(dz, limit)
        rgb[np.isnan(dz)] = 255
        axis.imshow(rgb, extent=extent)
        axis.set_title(title)
    sizes = np.unique(grown.partition.sizes[grown.valid])
    colours = [np.array(colour, dtype=float) for colour in sequential_steps(len(sizes))]
    rgb = np.full((*grid.shape, 3), 255, dtype=np.uint8)
    handles = []
    for size, colour in zip(sizes, colours, strict=True):
        rgb[grown.partition.sizes == size] = np.rint(colour)
        red, green, blue = (float(part) / 255 for part in colour)
        handles.append(Patch(facecolor=(red, green, blue), edgecolor="#777777", label=f"{size:g} m"))
    axes[4].imshow(rgb, extent=extent)
    axes[4].set_title("side of the grown cells")
    axes[4].legend(handles=handles, fontsize=8, loc="lower right")
    points = [np.bincount(cell_index(c, grid), minlength=grid.rows * grid.columns) for c in (first, second)]
    fewest = np.minimum(*points).reshape(grid.shape)
    axes[5].imshow(
        np.where(fewest, np.maximum(200 - 50 * fewest, 0), 255), extent=extent, cmap="gray", vmin=0, vmax=255
    )
    axes[5].set_title("ground points of both surveys")
    for axis in axes:
        axis.set_xlabel("m")
        axis.set_aspect("equal")
    figure.suptitle(
        f"Simulated slope, {100 * vegetation:.0f} % vegetation; red sank, blue rose, full colour from {limit:g} m"
    )
    FigureCanvasAgg(figure).print_png(str(path))
