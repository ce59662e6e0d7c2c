"""Changes put into raw strips of real forests and slopes, through ``inspect`` at its defaults.

Strips of one flight show no change; patches of known height are put into the second one. Each pair runs without patches
(false zones, cells beyond the level, registration error) and with one set of patches a seed. A single pair:
``python -m slopewatch.lab.benchmarks.changes_in_strips NAME [SEED ...]``; ``NAMES`` lists them.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import pyproj
import rasterio
import shapely
from numpy.typing import NDArray
from rasterio.features import rasterize

from ...engine.core.arrays import Bool, Float
from ...interface.parameters import SurveyParameters
from ...simulation.surveys.survey import simulate_pair
from .ground_clouds import VENDORS_GROUND
from .open_places import offset_of_open_places
from .patches import Patch, placed, total_rise
from .real_data import DATA
from .table import Row, say
from .watched import exit_of

SEEDS = (1, 2)
SIZES = ((-0.5, 4.0), (0.3, 2.0), (0.5, 4.0), (-0.3, 2.0), (-0.2, 4.0), (0.1, 2.0), (0.2, 4.0), (-0.1, 2.0))
"""Heights and radii of the patches of a run, m, the larger first: they need more room."""
GAP_M = 3.0
FOUND_SHARE = 0.5
"""A patch is found if zones of its sign hold this share of the middle, where it moved by half of its height."""
BEYOND = (0.03, 0.07)
MAX_UNREPORTED = 0.05


@dataclass(frozen=True)
class Survey:
    """Points (n, 3), m, whether each is ground by the vendor's or the simulation's word, return number and count."""

    xyz: Float
    ground: Bool
    number: NDArray[np.uint8]
    total: NDArray[np.uint8]

    def changed(self, patches: Sequence[Patch]) -> Survey:
        rise = total_rise(patches, self.xyz)
        return Survey(self.xyz + rise[:, None] * [0.0, 0.0, 1.0], self.ground, self.number, self.total)


@dataclass(frozen=True)
class Pair:
    """Two surveys of one place: of ``files`` the points of ``sources`` (all if empty) in a square of ``side`` m."""

    name: str
    files: tuple[str, str]
    sources: tuple[tuple[int, ...], tuple[int, ...]]
    crs: int
    side: float
    middle: tuple[float, float] = (0.5, 0.5)
    """Where the square's middle lies in the extent of the first file, as shares."""

    @property
    def missing(self) -> bool:
        return not all((DATA / file).is_file() for file in self.files)

    def load(self) -> tuple[Survey, Survey, shapely.Polygon]:
        """Both surveys, and what both reach."""
        first, second = (laspy.read(DATA / file) for file in self.files)
        low, high = first.header.mins[:2], first.header.maxs[:2]
        middle = low + (high - low) * self.middle
        found = _part(first, self.sources[0], middle, self.side), _part(second, self.sources[1], middle, self.side)
        low = np.max([survey.xyz[:, :2].min(axis=0) for survey in found], axis=0)
        high = np.min([survey.xyz[:, :2].max(axis=0) for survey in found], axis=0)
        return *found, shapely.box(*low, *high)


_BC, _CH, _UAV, _ALS, _SC = (
    "terrain/british_columbia_forest.laz",
    "terrain/chablais_forest.laz",
    "forest_pair/uav_2020-09-22.laz",
    "forest_pair/als_2020-09-19.laz",
    "terrain/santa_cruz_gullies.laz",
)
PAIRS = (
    Pair("british_columbia", (_BC, _BC), ((68,), (67,)), 3005, 70.0),
    Pair("british_columbia north", (_BC, _BC), ((68,), (67,)), 3005, 70.0, (0.6, 0.8)),
    Pair("chablais", (_CH, _CH), ((25130,), (25043, 24055)), 2154, 75.0),
    Pair("pine UAV lines", (_UAV, _UAV), ((101, 103, 105), (102, 104, 106)), 6341, 30.0),
    Pair("pine ALS UAV", (_ALS, _UAV), ((), ()), 6341, 30.0),
    Pair("pine UAV ALS", (_UAV, _ALS), ((), ()), 6341, 30.0),
    Pair("coromandel", ("terrain/coromandel_forest.laz",) * 2, ((135,), (136,)), 2193, 50.0, (0.87, 0.5)),
    Pair("santa_cruz", (_SC, _SC), ((8706,), (8707,)), 26911, 70.0, (0.35, 0.55)),
)
SIMULATED = {
    "simulated shrubs": SurveyParameters(seed=71, points=60_000, length=45.0, height=14.0, vegetation=0.5),
    "simulated grass": SurveyParameters(seed=72, points=60_000, length=45.0, height=14.0, vegetation=0.0, grass=0.8),
}
"""Slopes of 45 m by 24 m, about 45 returns a m²."""
SIMULATED_CRS = 6677
NAMES = (*(pair.name for pair in PAIRS), *SIMULATED)


@dataclass(frozen=True)
class Paths:
    """What a run reads and writes."""

    first: Path
    second: Path
    roi: Path
    results: Path


@dataclass(frozen=True)
class Outcome:
    """Of one run: zones that touch no patch, of each patch whether it was found; shares of the cells.

    ``beyond``: compared cells without change beyond the level, ``unreported``: compared cells whose true change exceeds
    the level and that no zone holds. ``stated`` is the registration error, ``off`` the height of the later survey over
    the earlier one after it, with its standard error and the number of open places that show it, m.
    """

    false: int
    found: tuple[bool, ...]
    beyond: float
    unreported: float
    compared: float
    level: float
    stated: float
    off: tuple[float, float, int]
    seconds: float

    def text(self) -> str:
        return (
            f"false zones {self.false}; beyond {self.beyond:.1%}, unreported {self.unreported:.1%}, compared "
            f"{self.compared:.0%}, level {self.level:.3f} m, registration stated {self.stated:.4f} m, off "
            f"{self.off[0]:+.4f} +- {self.off[1]:.4f} m at {self.off[2]} open places; {self.seconds:.0f} s"
        )


def rows() -> list[Row]:
    """Of all pairs, real ones first."""
    table: list[Row] = []
    for name in NAMES:
        outcomes = list(_runs(name, SEEDS))
        if not outcomes:
            continue
        still = outcomes[0][1]
        table.append(Row(f"{name}: without change", still.text(), "0 false zones", "", still.false == 0))
        low, high = BEYOND
        share = f"{still.beyond:.1%}"
        table.append(
            Row(f"{name}: beyond the level", share, f"{low:.0%} to {high:.0%}", "", low <= still.beyond <= high)
        )
        table += _size_rows(name, outcomes[1:])
    return table


def _size_rows(name: str, outcomes: Sequence[tuple[list[Patch], Outcome]]) -> list[Row]:
    hits: dict[str, list[bool]] = {}
    for patches, outcome in outcomes:
        for patch, found in zip(patches, outcome.found, strict=True):
            hits.setdefault(f"{abs(patch.height):g} m x {2 * patch.radius:g} m", []).append(found)
    false = sum(outcome.false for _, outcome in outcomes)
    unreported = max(outcome.unreported for _, outcome in outcomes)
    said = ", ".join(f"{size} {sum(found)} of {len(found)}" for size, found in hits.items())
    return [
        Row(f"{name}: changes found", said, "", f"{false} false zones", None),
        Row(f"{name}: cells unreported", f"{unreported:.1%}", "<= 5 %", "", unreported <= MAX_UNREPORTED),
    ]


def _runs(name: str, seeds: Sequence[int]) -> Iterator[tuple[list[Patch], Outcome]]:
    """Patches and outcome: first without a change, then with those of each seed; none if the data are missing."""
    pair = next((p for p in PAIRS if p.name == name), None)
    if pair is not None and pair.missing:
        return
    first, second, slope = pair.load() if pair else _simulated(SIMULATED[name])
    crs = pair.crs if pair else SIMULATED_CRS
    grounds = [survey.xyz[survey.ground] for survey in (first, second) if survey.ground.any()]
    for seed in (0, *seeds):
        patches = placed(SIZES, grounds, np.random.default_rng([seed, 33]), GAP_M, slope) if seed else []
        with tempfile.TemporaryDirectory() as folder:
            paths = _written((first, second.changed(patches)), slope, crs, Path(folder))
            outcome = _outcome(paths, (first.xyz, second.xyz), patches, slope.area)
        hits = ", ".join(
            f"{p.height:+g} x {2 * p.radius:g} {'yes' if found else 'no'}"
            for p, found in zip(patches, outcome.found, strict=True)
        )
        say(f"{name}, seed {seed}: {outcome.text()}; {hits or 'no patches'}")
        yield patches, outcome


def _written(surveys: Sequence[Survey], slope: shapely.Polygon, crs: int, folder: Path) -> Paths:
    paths = Paths(folder / "first.las", folder / "second.las", folder / "roi.gpkg", folder / "results")
    for survey, path in zip(surveys, (paths.first, paths.second), strict=True):
        header = laspy.LasHeader(version="1.4", point_format=6)
        header.offsets, header.scales = np.floor(survey.xyz.min(axis=0)), np.full(3, 0.001)
        header.add_crs(pyproj.CRS.from_epsg(crs))
        las = laspy.LasData(header)
        las.xyz = survey.xyz
        las.return_number, las.number_of_returns = survey.number, survey.total
        las.write(path)
    gpd.GeoDataFrame(geometry=[slope], crs=crs).to_file(paths.roi)
    return paths


def _outcome(paths: Paths, surveys: tuple[Float, Float], patches: Sequence[Patch], area: float) -> Outcome:
    """``surveys``: points (n, 3) of both as they were before the change; ``area`` of the slope, m²."""
    started = time.monotonic()
    dates = f"2024-05-01={paths.first}", f"2024-06-01={paths.second}"
    arguments = ["--epoch", dates[0], "--epoch", dates[1], "--roi", str(paths.roi)]
    code, said = exit_of(["inspect", *arguments, "--output-dir", str(paths.results)])
    if code:
        raise RuntimeError(said)
    seconds = time.monotonic() - started
    change, transform = _raster(paths.results / "elevation_change.tif")
    level, _ = _raster(paths.results / "level_of_detection.tif")
    zones = gpd.read_file(paths.results / "zones.gpkg", layer="zones")
    columns, rows = np.meshgrid(np.arange(change.shape[1]) + 0.5, np.arange(change.shape[0]) + 0.5)
    middles = np.column_stack(transform @ (columns.ravel(), rows.ravel()))
    true = total_rise(patches, middles).reshape(change.shape)
    sign = _zones_sign(zones, change, transform)
    near = shapely.union_all([shapely.Point(p.east, p.north).buffer(p.radius) for p in patches])
    compared = np.isfinite(change)
    unreported = compared & (np.abs(true) > level) & (sign == 0)
    record = json.loads((paths.results / "run.json").read_text(encoding="utf-8"))
    return Outcome(
        false=int((~zones.geometry.intersects(near)).sum()),
        found=tuple(_found(patch, middles, sign) for patch in patches),
        beyond=float((np.abs(change) > level)[compared & (true == 0.0)].mean()),
        unreported=float(unreported.sum() / max(compared.sum(), 1)),
        compared=float(compared.sum() * transform.a**2 / area),
        level=float(np.nanmedian(level[compared])),
        stated=float(record["registration"]["registration_error_m"]),
        off=offset_of_open_places(surveys[0], _registered(paths.results, surveys[1])),
        seconds=seconds,
    )


def _raster(path: Path) -> tuple[Float, rasterio.Affine]:
    with rasterio.open(path) as raster:
        return raster.read(1, masked=True).filled(np.nan), raster.transform


def _zones_sign(zones: gpd.GeoDataFrame, change: Float, transform: rasterio.Affine) -> Float:
    """Of each cell: -1 or 1 in a zone that sank or rose, 0 outside."""
    sign = np.zeros(change.shape)
    for shape in zones.geometry:
        inside = rasterize([shape], change.shape, transform=transform).astype(bool)
        sign[inside] = np.sign(np.nanmean(change[inside]))
    return sign


def _found(patch: Patch, middles: Float, sign: Float) -> bool:
    there = (patch.away(middles) <= patch.radius / 2).reshape(sign.shape)
    return bool((sign[there] == np.sign(patch.height)).mean() >= FOUND_SHARE)


def _registered(results: Path, xyz: Float) -> Float:
    matrix = np.array(json.loads((results / "transform.json").read_text(encoding="utf-8"))["matrix"])
    return np.asarray(xyz @ matrix[:3, :3].T + matrix[:3, 3])


def _part(las: laspy.LasData, sources: tuple[int, ...], middle: Float, side: float) -> Survey:
    xyz = np.array(las.xyz)
    kept = (np.abs(xyz[:, :2] - middle) <= side / 2).all(axis=1)
    if sources:
        kept &= np.isin(np.asarray(las.point_source_id), sources)
    ground = np.asarray(las.classification)[kept] == VENDORS_GROUND
    return Survey(xyz[kept], ground, np.asarray(las.return_number)[kept], np.asarray(las.number_of_returns)[kept])


def _simulated(parameters: SurveyParameters) -> tuple[Survey, Survey, shapely.Polygon]:
    """Both surveys in the first one's place, and the slope."""
    pair = simulate_pair(parameters, changes=())
    places = pair.first.xyz, pair.transform.apply(pair.second.xyz)
    clouds = zip((pair.first, pair.second), places, strict=True)
    found = [Survey(xyz, c.truth_ground == 1, c.return_number, c.number_of_returns) for c, xyz in clouds]
    return found[0], found[1], shapely.Polygon(pair.roi)


if __name__ == "__main__":
    for _ in _runs(sys.argv[1], [int(seed) for seed in sys.argv[2:]] or SEEDS):
        pass
