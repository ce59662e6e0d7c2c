"""A difference of two surveys with its error against xDEM: registered, on cells, and how often a level is exceeded."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...engine.core.arrays import Float
from ...engine.core.version import VERSION
from ...engine.grid.grid import Grid, snapped_grid
from ...interface.parameters import SurveyParameters
from ...simulation.surveys.change import true_change_raster
from ...simulation.surveys.survey import SimulatedPair, simulate_pair
from .chain import inside
from .peer_case import Case, Judged, own_tool, script_tool
from .peers import version
from .strips import FILE, load

CELL_M, REAL_CELL_M = 0.25, 1.0
POINTS, QUICK_POINTS = 1_000_000, 200_000
UNCHANGED_M = 0.002
HEAD = """
import json, sys, time
import numpy as np
folder = sys.argv[1]
first, second = (np.load(f"{folder}/{name}.npy") for name in ("first", "second"))
west, north, cell, rows, columns = np.load(f"{folder}/grid.npy")
rows, columns = int(rows), int(columns)
"""
TAIL = """
np.save(f"{folder}/found/dz.npy", dz)
np.save(f"{folder}/found/level.npy", level)
np.save(f"{folder}/found/corner.npy", np.array(corner))
print(json.dumps({"seconds": taken[0], "cpu": taken[1], "approach": approach}))
"""
OWN = (
    HEAD
    + """
from slopewatch.engine.change.difference import difference
from slopewatch.engine.registration.register import register
from slopewatch.interface.parameters import ChangeParameters, RegistrationParameters
started, cpu = time.perf_counter(), time.process_time()
found = register(first, second, RegistrationParameters())
change = difference(
    first, found.transform.apply(second), ChangeParameters(cell=cell, adaptive=False),
    registration_error=found.registration_error)
taken = time.perf_counter() - started, time.process_time() - cpu
approach = ""
dz, level, corner = change.dz, change.level, [change.grid.west, change.grid.north]
"""
    + TAIL
)
XDEM = (
    HEAD
    + """
import rasterio
import xdem
started, cpu = time.perf_counter(), time.process_time()
def dem(xyz):
    # the mean height of each cell's points, as a common gridding gives it
    place = np.floor((north - xyz[:, 1]) / cell).astype(int), np.floor((xyz[:, 0] - west) / cell).astype(int)
    kept = (place[0] >= 0) & (place[0] < rows) & (place[1] >= 0) & (place[1] < columns)
    flat = place[0][kept] * columns + place[1][kept]
    with np.errstate(invalid="ignore"):
        mean = np.bincount(flat, xyz[kept, 2], rows * columns) / np.bincount(flat, minlength=rows * columns)
    transform = rasterio.transform.from_origin(west, north, cell, cell)
    return xdem.DEM.from_array(mean.reshape(rows, columns).astype("float32"), transform, "EPSG:32651", nodata=-9999)
reference, moving = dem(first), dem(second)
aligned = moving.coregister_3d(reference, xdem.coreg.NuthKaab(), random_state=1)
change = aligned - reference
spread = xdem.spatialstats.nmad
values = np.ma.filled(change.data, np.nan)
slope, curved = aligned.slope(), aligned.max_curvature()
curved = curved.copy(new_array=np.abs(curved.data))
stable = change.copy(new_array=np.isfinite(values).astype("uint8")) == 1
try:
    fitted = xdem.spatialstats.infer_heteroscedasticity_from_stable(
        dvalues=change, list_var=[slope, curved], list_var_names=["slope", "maxc"], stable_mask=stable)[0]
    error, approach = fitted.data.filled(np.nan), "slope and curvature"
    if not np.isfinite(error[np.isfinite(values)]).any():
        raise ValueError("no error for any cell")
except (ValueError, RuntimeError, IndexError):
    # it needs a hundred cells in each of its classes of slope and curvature
    error, approach = np.full(values.shape, spread(values[np.isfinite(values)])), "one NMAD"
taken = time.perf_counter() - started, time.process_time() - cpu
dz, level = values, 1.959964 * np.broadcast_to(error, values.shape)
corner = [west, north]
"""
    + TAIL
)
TOOLS = (
    own_tool("SlopeWatch register and change", VERSION, OWN),
    script_tool("xDEM, Nuth and Kääb, its uncertainty", "xdem", version("xdem"), XDEM),
)


def cases(quick: bool) -> list[Case]:
    """A simulated slope with change and an offset of 0.2 m; two real airborne strips of one day."""
    found = [
        Case("difference", f"simulated ground, cells of {CELL_M:g} m", lambda f: _simulated(f, quick), _judge, TOOLS)
    ]
    if FILE.exists():
        title = f"two real strips, nothing moved, cells of {REAL_CELL_M:g} m"
        found.append(Case("difference", title, lambda folder: _strips(folder, quick), _judge, TOOLS))
    return found


def _simulated(folder: Path, quick: bool) -> SimulatedPair:
    pair = simulate_pair(SurveyParameters(seed=1, points=QUICK_POINTS if quick else POINTS), roi_buffer=2.0)
    first, second = (c.xyz[c.truth_ground == 1] for c in (pair.first, pair.second))
    kept = inside(first, pair), inside(second, pair)
    _write(folder, first[kept[0]], second[kept[1]], CELL_M)
    return pair


def _strips(folder: Path, quick: bool) -> None:
    strips = load()
    first, second = strips.first, strips.second
    if quick:
        middle = np.median(first[:, :2], axis=0)
        first, second = (xyz[(np.abs(xyz[:, :2] - middle) < 40).all(axis=1)] for xyz in (first, second))
    _write(folder, first, second, REAL_CELL_M)


def _write(folder: Path, first: Float, second: Float, cell: float) -> None:
    grid = snapped_grid((*first[:, :2].min(0), *first[:, :2].max(0)), cell)
    np.save(folder / "first.npy", first)
    np.save(folder / "second.npy", second)
    np.save(folder / "grid.npy", np.array([grid.west, grid.north, grid.cell, grid.rows, grid.columns]))


def _judge(truth: SimulatedPair | None, found: Path, printed: Mapping[str, Any]) -> Judged:
    """Errors of the change against the true one, and how many unchanged cells lie beyond their 95 % level."""
    dz, level = np.load(found / "dz.npy"), np.load(found / "level.npy")
    level = np.broadcast_to(level, dz.shape)
    true = np.zeros(dz.shape)
    if truth is not None:
        west, north = np.load(found / "corner.npy")
        grid = Grid(float(west), float(north), CELL_M, *dz.shape)
        true = true_change_raster(truth.changes, truth.scene.frame, grid, 8)
    found_by = printed["approach"]
    return judged(dz, level, true, f" (error from {found_by})" if found_by else "")


def judged(dz: Float, level: Float, true: Float, note: str = "") -> Judged:
    """Figures of a change (rows, columns), its level of detection and the truth, metres; ``note`` goes to the level."""
    known = np.isfinite(dz) & np.isfinite(level)
    error = dz[known] - true[known]
    still = np.abs(true[known]) <= UNCHANGED_M
    median, rms = np.median(error), float(np.sqrt(np.mean(error**2)))
    spread = 1.4826 * np.median(np.abs(error - median))
    beyond = np.mean(np.abs(dz[known][still]) > level[known][still])
    accuracy = f"{1000 * rms:.1f} mm rms, NMAD {1000 * spread:.1f} mm, median {1000 * median:+.1f} mm"
    stated = (
        f"median level {1000 * np.median(level[known]):.0f} mm{note}; {100 * beyond:.1f} % of unchanged cells beyond it"
    )
    text = f"{accuracy} of {known.sum():,} cells; {stated}"
    return Judged(1000 * rms, text)
