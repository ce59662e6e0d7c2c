"""What became of a simulated survey that went through ``inspect``: judged from the files that it wrote."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.features import rasterize

from ...engine.core.arrays import Float
from ...engine.grid.grid import Grid
from ...engine.statistics.normal import Z95
from ...simulation.surveys.change import Bump, Plateau, Slump, true_change_raster
from ...simulation.surveys.survey import SimulatedPair

FOUND = 0.5
"""A change is found if zones of its sign hold this share of its measured cells beyond half of its height."""
MAX_STILL_M = 0.005
"""A zone is false if nowhere in it the ground has moved by more than this, m of height."""


@dataclass(frozen=True)
class KnownChange:
    """A change, or a lobe of it: height and level of detection on it (m, both square to the slope where the run
    measured so), area m², the share of its core in zones of its sign, and whether any of these touches it.
    """

    kind: str
    height: float
    area: float
    level: float
    share: float
    touched: bool

    @property
    def ratio(self) -> float:
        return abs(self.height) / self.level

    @property
    def found(self) -> bool:
        return self.share >= FOUND


@dataclass(frozen=True)
class FoundZone:
    """A zone: area m², confidence, volume with its standard error and the true one over its footprint, m³."""

    area: float
    confidence: float
    volume: float
    error: float
    true: float
    footprint: float
    false: bool

    @property
    def held(self) -> bool:
        return abs(self.volume - self.true) <= Z95 * self.error


@dataclass(frozen=True)
class NetVolume:
    """A sum with its standard error and the truth, m³."""

    value: float
    error: float
    true: float

    @property
    def held(self) -> bool:
        return abs(self.value - self.true) <= Z95 * self.error


@dataclass(frozen=True)
class Outcome:
    """Of one survey; ``code`` is the exit code and ``said`` the last line that it wrote, where it is not 0.

    ``net`` is of all compared cells, ``zones_net`` of the footprints, None without zones.
    """

    seed: int
    angle: float
    density: float
    vegetation: float
    grass: float
    code: int
    said: str
    direction: str
    registration_error: float
    level: float
    changes: tuple[KnownChange, ...]
    zones: tuple[FoundZone, ...]
    net: NetVolume
    zones_net: NetVolume | None

    @property
    def sentence(self) -> str:
        """In one line."""
        head = (
            f"{self.seed}: {self.angle:.0f} degrees, {self.density:.0f} returns a m², plants "
            f"{100 * self.vegetation:.0f} %, grass {100 * self.grass:.0f} %: "
        )
        if self.code:
            return f"{head}exit code {self.code}, {self.said}"
        false = sum(z.false for z in self.zones)
        held = sum(z.held for z in self.zones)
        return (
            f"{head}{sum(c.found for c in self.changes)} of {len(self.changes)} found, {false} false, intervals hold "
            f"{held} of {len(self.zones)}, net {'holds' if self.net.held else 'DOES NOT HOLD'}"
        )


_NONE = NetVolume(math.nan, math.nan, math.nan)


def refused(seed: int, pair: SimulatedPair, code: int, said: str) -> Outcome:
    """A run that ended with ``code``."""
    return Outcome(seed, *_conditions(pair), code, said, "", math.nan, math.nan, (), (), _NONE, None)


def judged(seed: int, pair: SimulatedPair, folder: Path) -> Outcome:
    """The files of a run in ``folder`` against the truth."""
    record = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    with rasterio.open(folder / "elevation_change.tif") as raster:
        known = np.isfinite(raster.read(1, masked=True).filled(np.nan))
        transform = raster.transform
    with rasterio.open(folder / "level_of_detection.tif") as raster:
        level = raster.read(1, masked=True).filled(np.nan).astype(np.float64)
    grid = Grid(transform.c, transform.f, transform.a, *known.shape)
    truth = pair.true_change_raster(grid, 8)
    zones = gpd.read_file(folder / "zones.gpkg", layer="zones")
    footprints = gpd.read_file(folder / "zones.gpkg", layer="footprints")

    def burnt(frame: gpd.GeoDataFrame) -> NDArray[np.int32]:
        shapes = [(shape, number) for number, shape in enumerate(frame.geometry, 1)]
        if not shapes:
            return np.zeros(grid.shape, dtype=np.int32)
        return rasterize(shapes, out_shape=grid.shape, transform=transform, dtype="int32")

    labels, named = burnt(zones), burnt(footprints)
    normal = record["level_of_detection"]["direction"] == "normal"
    square = math.cos(math.radians(pair.parameters.angle)) if normal else 1.0
    signs = np.sign(np.concatenate([[0.0], zones["vol_net_m3"].to_numpy(dtype=np.float64)]))[labels]
    lines = _lines(folder / "volumes.csv")
    of_all = lines["VOLUMETRIC", "Total Net Volume Difference"]
    of_zones = lines["ZONES (OVER THEIR FOOTPRINTS)", "Total Net Volume Difference"]
    area = grid.cell**2
    return Outcome(
        seed,
        *_conditions(pair),
        0,
        "",
        record["level_of_detection"]["direction"],
        record["metrics"]["registration_error_m"],
        record["metrics"]["lod_median_m"],
        changes=tuple(
            _known(part, pair, grid, known, level, signs, square) for change in pair.changes for part in _parts(change)
        ),
        zones=_zones(zones, footprints, labels, named, truth, area),
        net=NetVolume(float(of_all["raw"]), float(of_all["raw_error"]), float(truth[known].sum() * area)),
        zones_net=None
        if zones.empty
        else NetVolume(
            float(of_zones["thresholded"]), float(of_zones["standard_error"]), float(truth[named > 0].sum() * area)
        ),
    )


def _conditions(pair: SimulatedPair) -> tuple[float, float, float, float]:
    """Angle, returns a m² of the region on the map, and shares of shrubs and trees and of grass."""
    parameters = pair.parameters
    u0, v0, u1, v1 = pair.scene.slope
    density = parameters.points * 0.58 / ((u1 - u0) * (v1 - v0))
    return parameters.angle, density, parameters.vegetation, parameters.grass


def _lines(path: Path) -> dict[tuple[str, str], dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return {(line["group"], line["quantity"]): line for line in csv.DictReader(file)}


def _parts(change: Any) -> tuple[Any, ...]:
    return change.lobes if isinstance(change, Slump) else (change,)


def _known(
    part: Bump | Plateau,
    pair: SimulatedPair,
    grid: Grid,
    known: NDArray[np.bool_],
    level: Float,
    signs: Float,
    square: float,
) -> KnownChange:
    raster = true_change_raster((part,), pair.scene.frame, grid, 8)
    alone = np.abs(raster) > 0.5 * abs(part.height)
    core = alone & known
    measured = bool(core.any())
    right = signs == np.sign(part.height)
    area = part.side**2 if isinstance(part, Plateau) else math.pi * part.half_u * part.half_v
    return KnownChange(
        part.kind,
        part.height * square,
        area,
        float(np.nanmedian(level[core])) if measured else math.inf,
        float(np.mean(right[core if measured else alone])),
        bool((right & (np.abs(raster) > MAX_STILL_M)).any()),
    )


def _zones(
    zones: gpd.GeoDataFrame,
    footprints: gpd.GeoDataFrame,
    labels: NDArray[np.int32],
    named: NDArray[np.int32],
    truth: Float,
    area: float,
) -> tuple[FoundZone, ...]:
    order = list(footprints["zone_id"])
    found = []
    for number, row in enumerate(zones.itertuples(), 1):
        inside = named == order.index(row.zone_id) + 1
        found.append(
            FoundZone(
                float(row.area_m2),
                float(row.confidence),
                float(row.vol_net_m3),
                float(row.vol_err_m3),
                float(truth[inside].sum() * area),
                float(row.vol_area_m2),
                bool(np.abs(truth[labels == number]).max(initial=0.0) <= MAX_STILL_M),
            )
        )
    return tuple(found)


def write_outcome(path: Path, outcome: Outcome) -> None:
    """Add a line to the file ``path``."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(asdict(outcome)) + "\n")


def read_outcomes(path: Path) -> list[Outcome]:
    """All that ``write_outcome`` added; none where there is no file."""
    if not path.exists():
        return []
    return [_read(json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines() if line]


def _read(values: dict[str, Any]) -> Outcome:
    changes = tuple(KnownChange(**v) for v in values.pop("changes"))
    zones = tuple(FoundZone(**v) for v in values.pop("zones"))
    net, zones_net = values.pop("net"), values.pop("zones_net")
    return Outcome(
        **values,
        changes=changes,
        zones=zones,
        net=NetVolume(**net),
        zones_net=None if zones_net is None else NetVolume(**zones_net),
    )
