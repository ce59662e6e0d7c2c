"""Change between elevation models: real pairs whose biases are known, and volumes beside xDEM on simulated ones.

*Real pairs*: the share of stable cells beyond their level, by slope; on the cells that the level was taken from, and
with the level from one half of a chessboard on the other half. *Simulated pairs* (``demchange_pairs``): how often the
95 % interval of a changed place's volume holds the true one. Both programs coregister, take errors from the same
stable ground (given, or all the ground with the change in it) and get the same places.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ...engine.change.result import Change
from ...engine.core.arrays import Bool, Float
from ...engine.elevation_models.comparison import ModelChange, compare_models
from ...engine.elevation_models.model import read_model
from ...engine.grid.grid import Grid
from ...engine.statistics.normal import Z95
from ...engine.zones.change_zones import cells_of
from ...engine.zones.volumes import fit_correlation
from .demchange_pairs import CELL_M, ERRORS, SIDE, SimulatedModels, simulated_models
from .kept_cases import KeptCases
from .peers import PeerMissingError, run_peer, version
from .real_data import DATA
from .table import Row, counted, say

FOLDER = DATA / "dem_epochs"
PAIRS = 20  # simulated, for each kind of error
_AT_A_TIME = 4
_SLOPE_EDGES = (0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 90.0)
_MIN_CLASS_CELLS = 200
_SQUARES = 12  # of the chessboard along the longer side
_XDEM = """
import json, sys, time
import geopandas as gpd
import numpy as np
import rasterio, shapely, xdem
folder, count, given = sys.argv[1], int(sys.argv[2]), sys.argv[3] == "given"
found = []
for number in range(count):
    data = np.load(f"{folder}/{number}.npz")
    started, cpu = time.perf_counter(), time.process_time()
    transform = rasterio.transform.from_origin(500000, 3300000, 1.0, 1.0)
    first, second = (xdem.DEM.from_array(data[k].astype("float32"), transform, "EPSG:32651", nodata=-9999)
                     for k in ("first", "second"))
    stable = data["stable"] if given else np.ones(first.shape, bool)
    mask = first.copy(new_array=stable.astype("uint8")) == 1
    aligned = second.coregister_3d(first, xdem.coreg.NuthKaab(), inlier_mask=mask, random_state=1)
    dh = aligned - first
    values = dh.data.filled(np.nan)
    slope, curved = first.slope(), first.max_curvature()
    curved = curved.copy(new_array=np.abs(curved.data))
    how = "slope and curvature"
    try:
        error = xdem.spatialstats.infer_heteroscedasticity_from_stable(
            dvalues=dh, list_var=[slope, curved], list_var_names=["slope", "maxc"], stable_mask=mask)[0]
    except (ValueError, RuntimeError, IndexError):
        spread = xdem.spatialstats.nmad(values[stable & np.isfinite(values)])
        error, how = first.copy(new_array=np.full(values.shape, spread, "float32")), "one NMAD"
    model = xdem.spatialstats.infer_spatial_correlation_from_stable(
        dvalues=dh, list_models=["Gaussian", "Spherical"], stable_mask=mask, errors=error, random_state=1)[1]
    volumes, errors = [], []
    for top, bottom, left, right in data["places"]:
        area = shapely.box(500000 + left, 3300000 - bottom, 500000 + right, 3300000 - top)
        place = gpd.GeoDataFrame(geometry=[area], crs="EPSG:32651")
        of_mean = xdem.spatialstats.spatial_error_propagation(
            areas=[place], errors=error, params_variogram_model=model)[0]
        inside = values[top:bottom, left:right]
        volumes.append(float(np.nanmean(inside)) * area.area)
        errors.append(float(of_mean) * area.area)
    taken = time.perf_counter() - started, time.process_time() - cpu
    found.append({"volumes": volumes, "errors": errors, "seconds": taken[0], "cpu": taken[1], "how": how})
print(json.dumps({"pairs": found}))
"""


@dataclass(frozen=True)
class Volumes:
    """Of the changed places of simulated pairs (n,), m³, and the processor time of each pair, seconds."""

    measured: Float
    error: Float
    true: Float
    cpu: Float
    how: str = ""

    @property
    def covered(self) -> list[bool]:
        """Whether the 95 % interval holds the true volume."""
        return (np.abs(self.measured - self.true) <= Z95 * self.error).tolist()

    @property
    def interval_score(self) -> float:
        """Mean score of the 95 % intervals, m³: their width, and 40 times what the truth lies outside; less is better.

        Gneiting and Raftery (2007), equation 43: it asks for intervals that hold the truth and are narrow.
        """
        outside = np.maximum(np.abs(self.measured - self.true) - Z95 * self.error, 0.0)
        return float(np.mean(2.0 * Z95 * self.error + 2.0 / 0.05 * outside))

    def words(self) -> str:
        score = (self.measured - self.true) / self.error
        rms = float(np.sqrt(np.mean((self.measured - self.true) ** 2)))
        text = (
            f"{counted(self.covered, 0)}; errors {np.sqrt(np.mean(score**2)):.2f} of those stated, {rms:.0f} m³ rms, "
            f"interval score {self.interval_score:.0f} m³; {np.median(self.cpu):.1f} s of processor a pair"
        )
        return text + (f" (errors by {self.how})" if self.how else "")


def rows(store: Path | None = None) -> list[Row]:
    """Real pairs, then coverage beside xDEM; simulated pairs that ``store`` holds are not measured again."""
    kept = KeptCases(store and store.with_suffix(".jsonl"))
    found = _real() if FOLDER.is_dir() else []
    for kind in ERRORS:
        found += [_coverage(kept, kind, given=given) for given in (True, False)]
    return found


def _real() -> list[Row]:
    years = (2004, 2012, 2016)
    gully = {year: read_model(FOLDER / f"fort_bragg_gully_{year}.tif") for year in years}
    found = []
    for a, b in combinations(years, 2):
        say(f"gully, {a} and {b}")
        first, second, grid = gully[a].heights, gully[b].heights, gully[a].grid
        whole = compare_models(first, second, grid)
        found.append(_levels(f"gully {a} to {b}", whole, _by_slope(whole.change, whole.change.stable)))
        found.append(_held_out(f"gully {a} to {b}", first, second, grid, whole))
    say("park")
    park = [read_model(FOLDER / f"toronto_park_{year}.tif") for year in (2015, 2023)]
    whole = compare_models(park[0].heights, park[1].heights, park[0].grid)
    c, dz = whole.coregistration, whole.change.dz
    moved = float(np.nanmedian(dz))
    found.append(
        Row(
            "park 2015 to 2023: bias; median change that is left",
            f"{c.bias:+.3f} m (standard error {c.errors[2]:.3f} m); {moved:+.4f} m",
            "-0.544 m; 0 m",
            f"shift in plan {c.east:+.2f} m east, {c.north:+.2f} m north; NMAD {c.nmad_before:.3f} to "
            f"{c.nmad_after:.3f} m",
            abs(c.bias + 0.544) < 2 * c.errors[2] and abs(moved) < 0.01,
        )
    )
    found.append(_levels("park", whole, _by_slope(whole.change, whole.change.stable)))
    return found


def _by_slope(change: Change, cells: Bool) -> dict[str, tuple[float, int]]:
    """Share of ``cells`` beyond their level, and their number, in classes of slope that have enough."""
    found = {}
    for low, high in pairwise(_SLOPE_EDGES):
        here = cells & change.valid & (change.slope >= low) & (change.slope < high)
        if int(here.sum()) >= _MIN_CLASS_CELLS:
            found[f"{low:g} to {high:g}°"] = float(change.significant[here].mean()), int(here.sum())
    return found


def _levels(name: str, found: ModelChange, classes: dict[str, tuple[float, int]], where: str = "") -> Row:
    c = found.coregistration
    shares = [share for share, _ in classes.values()]
    return Row(
        f"{name}: stable cells beyond their level, by slope{where}",
        ", ".join(f"{slope} {100 * share:.1f} %" for slope, (share, _) in classes.items()),
        "3 to 7 %",
        f"bias {c.bias:+.3f} m ({c.errors[2]:.3f} m), median level {found.change.median_level:.3f} m, "
        f"{100 * found.change.stable.sum() / found.change.valid.sum():.0f} % stable",
        all(0.03 <= share <= 0.07 for share in shares),
    )


def _held_out(name: str, first: Float, second: Float, grid: Grid, whole: ModelChange) -> Row:
    """The level from one half of a chessboard, on the stable cells of the other half; both ways."""
    side = -(-max(grid.shape) // _SQUARES)
    white = (np.arange(grid.rows)[:, None] // side + np.arange(grid.columns) // side) % 2 == 0
    stable = whole.change.stable
    beyond, total = dict[str, float](), dict[str, int]()
    for half in (white, ~white):
        change = compare_models(first, second, grid, stable=stable & half).change
        for slope, (share, cells) in _by_slope(change, stable & ~half).items():
            beyond[slope] = beyond.get(slope, 0.0) + share * cells
            total[slope] = total.get(slope, 0) + cells
    classes = {slope: (beyond[slope] / total[slope], total[slope]) for slope in beyond}
    return _levels(name, whole, classes, ", on the half that the level is not from")


def _coverage(kept: KeptCases, kind: str, *, given: bool) -> Row:
    ground = "stable ground given" if given else "no stable ground given"
    own = _volumes(kept, f"errors {kind}, {ground}", kind, partial(own_volumes, given=given))
    met, words = None, ""
    try:
        peer = _volumes(
            kept, f"xDEM {version('xdem')}, errors {kind}, {ground}", kind, partial(xdem_volumes, given=given)
        )
    except PeerMissingError as error:
        words = str(error)
    else:
        words = f"xDEM {version('xdem')}: {peer.words()}"
        away = [abs(np.mean(volumes.covered) - 0.95) for volumes in (own, peer)]
        met = bool(away[0] <= away[1] and np.median(own.cpu) <= np.median(peer.cpu))
    return Row(
        f"simulated, errors {kind}, {ground}: 95 % intervals of volumes that hold the truth",
        own.words(),
        "nearer to 95 % than xDEM's, in no more time",
        words,
        met,
    )


def _volumes(
    kept: KeptCases, name: str, kind: str, measure: Callable[[Sequence[SimulatedModels]], Volumes]
) -> Volumes:  # fmt: skip
    """Of all pairs, measured some at a time."""

    def some(seeds: range) -> dict[str, Any]:
        found = measure([simulated_models(seed, ERRORS[kind]) for seed in seeds])
        return {key: value if key == "how" else value.tolist() for key, value in vars(found).items()}

    parts = []
    for first in range(0, PAIRS, _AT_A_TIME):
        seeds = range(first, min(first + _AT_A_TIME, PAIRS))
        parts.append(kept.get(f"{name}, pairs {seeds.start} to {seeds.stop - 1}", partial(some, seeds)))
        say(f"{name}, pairs to {seeds.stop - 1}")
    measured, error, true, cpu = (
        np.concatenate([part[k] for part in parts]) for k in ("measured", "error", "true", "cpu")
    )
    how = {word for part in parts for word in str(part["how"]).split(" or ") if word}
    return Volumes(measured, error, true, cpu, " or ".join(sorted(how)))


def own_volumes(cases: Sequence[SimulatedModels], *, given: bool) -> Volumes:
    """As the command measures them, over the places given."""
    grid = Grid(500_000.0, 3_300_000.0, CELL_M, SIDE, SIDE)
    measured, errors, taken = [], [], []
    for case in cases:
        started = time.process_time()
        change = compare_models(case.first, case.second, grid, stable=case.stable if given else None).change
        cells = cells_of(change)
        model = fit_correlation(cells, change.stable, change.registration_error)
        for place in case.places:
            weights = np.zeros(grid.shape)
            weights[place] = np.isfinite(change.dz[place]) * CELL_M**2
            # what has no height counts as the mean of the rest
            filled = math.prod(weights[place].shape) * CELL_M**2 / weights.sum()
            measured.append(filled * float(np.nansum(weights * change.dz)))
            errors.append(filled * model.sum_error(weights, cells))
        taken.append(time.process_time() - started)
    return Volumes(np.array(measured), np.array(errors), _true(cases), np.array(taken))


def xdem_volumes(cases: Sequence[SimulatedModels], *, given: bool) -> Volumes:
    """As its documentation combines coregistration, errors by terrain and their correlation.

    Raises:
        PeerMissingError: it cannot be installed.
    """
    with tempfile.TemporaryDirectory() as name:
        for number, case in enumerate(cases):
            places = np.array([[r.start, r.stop, c.start, c.stop] for r, c in case.places])
            file = Path(name) / f"{number}.npz"
            np.savez(file, first=case.first, second=case.second, stable=case.stable, places=places)
        known = "given" if given else "all"
        pairs = run_peer("xdem", _XDEM, name, str(len(cases)), known, threads=1)["pairs"]
    how = {str(pair["how"]) for pair in pairs}
    return Volumes(
        np.concatenate([pair["volumes"] for pair in pairs]),
        np.concatenate([pair["errors"] for pair in pairs]),
        _true(cases),
        np.array([pair["cpu"] for pair in pairs]),
        " or ".join(sorted(how)),
    )


def _true(cases: Sequence[SimulatedModels]) -> Float:
    return np.concatenate([case.volumes for case in cases])
