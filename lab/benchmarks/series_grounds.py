"""Areas, volumes and intervals of the zones of simulated series, against a truth that no estimator has a part in."""

from __future__ import annotations

import csv
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import geopandas
import numpy as np
from affine import Affine
from rasterio.features import geometry_mask

from ...engine.core.arrays import Bool, Float
from ...engine.epochs.epoch import Epoch
from ...engine.grid.grid import snapped_grid
from ...engine.statistics.normal import Z95
from ...interface.parameters import (
    ChangeParameters,
    DisplacementStepParameters,
    SeriesParameters,
    SurveyParameters,
)
from ...simulation.surveys.change import Cone, Plateau, Slump
from ...simulation.surveys.series import Creep, Shape, simulate_series, survey_days, write_series
from ...workflows.series import monitor_series
from ...workflows.settings import SeriesSettings
from .table import Row, say

DENSITIES = (20, 50, 200)
"""Ground points a m²."""
SEEDS = range(1, 11)
_OTHER_SEEDS = range(1, 5)
_OTHER_SHAPES: tuple[Shape, ...] = (Cone(0, 0, 4.0, 1.0), Plateau(0, 0, 2.8, 1.0, 20.0), Slump(0, 0, 1.8, 5.6, 1.0))
_NAMES = ("cone", "plateau with vertical edges", "slide with its toe")
_LAWS = (Creep(-0.003, 15.0), Creep(0.004), Creep(-0.006, 45.0))
_GROUND_SHARES = ((0.2, 0.8), (0.45, 0.67), (0.7, 0.45))  # vegetation, and the share of echoes that are the ground's
_LEAST_SHARE = 0.1  # of the most: where ground moved by that, the true zone is
_NEAR = 0.1  # of the truth
_FINE_CELL_M = 0.05
_SETTINGS = SeriesSettings(
    change=ChangeParameters(),
    series=SeriesParameters(ground_ready=True, rasters_each_survey=False),
    displacement_step=DisplacementStepParameters(displacement=False),  # heights alone are measured here
)


@dataclass(frozen=True)
class Ground:
    """A zone's ground and volumes: area (m²) and net volume (m³) stated and true, and whether each survey's 95 %
    interval holds the true volume there; which of the laws moves it. The true area is where ground moved by a tenth of
    the most, or more; the true volume is of all that moved.
    """

    law: int
    area: float
    true_area: float
    volume: float
    true_volume: float
    held: tuple[bool, ...]


def ground_rows() -> list[Row]:
    """With the defaults: what is compared, and the zones' areas and volumes."""
    rows = []
    for density in DENSITIES:
        found = _all(density, SEEDS)
        shares = [share for compared, _ in found for share in compared]
        name = f"{density} ground points a m², 20 to 70 % vegetation"
        rows.append(
            Row(
                f"{name}: least share that is compared",
                f"{100 * min(shares):.0f} %",
                ">= 90 %",
                "",
                min(shares) >= 0.9,
            )
        )
        rows += _rows(name, [zone for _, zones in found for zone in zones])
    for density in DENSITIES:
        found = _all(density, _OTHER_SEEDS, _OTHER_SHAPES)
        for law, shape in enumerate(_NAMES):
            rows += _rows(f"{density} ground points a m², {shape}", [z for _, zs in found for z in zs if z.law == law])
    return rows


def _all(density: int, seeds: Sequence[int], shapes: Sequence[Shape] = ()) -> list[tuple[list[float], list[Ground]]]:
    found = []
    for seed in seeds:
        found.append(grown_series(seed, density, shapes))
        say(f"{density} ground points a m², seed {seed}: {len(found[-1][1])} zones")
    return found


def _rows(name: str, zones: Sequence[Ground]) -> list[Row]:
    if not zones:
        return [Row(f"{name}: zones", "0", "some", "", False)]
    held = np.concatenate([zone.held for zone in zones])
    areas = np.array([zone.area / zone.true_area for zone in zones])
    volumes = np.array([zone.volume / zone.true_volume for zone in zones])
    near = [100 * float(np.mean(np.abs(ratios - 1) <= _NEAR)) for ratios in (areas, volumes)]
    rows = [
        Row(
            f"{name}: zones with {what} within 10 % of the truth",
            f"{share:.0f} % of {len(zones)}; stated over true {np.median(ratios):.2f}",
            "all",
            f"{ratios.min():.2f} to {ratios.max():.2f}",
            share == 100,
        )
        for what, share, ratios in zip(("an area", "a volume"), near, (areas, volumes), strict=True)
    ]
    inside = float(held.mean())
    interval = f"{100 * inside:.1f} % of {len(held)}"
    return [
        *rows,
        Row(f"{name}: 95 % intervals that hold the volume", interval, "90 to 99 %", "", 0.9 <= inside <= 0.99),
    ]


def grown_series(seed: int, density: int, shapes: Sequence[Shape] = ()) -> tuple[list[float], list[Ground]]:
    """Shares of the ground that each survey compared, and the zones, of a series of five surveys of creep.

    Args:
        shapes: of what moves by each law; smooth bulges and bowls by default.
    """
    vegetation, share = _GROUND_SHARES[seed % 3]
    length, height, angle = 24.0, 9.0, 39.0
    points = int(density / share * length * height / math.tan(math.radians(angle)))
    parameters = SurveyParameters(
        seed=seed, points=points, length=length, height=height, angle=angle, vegetation=vegetation, offset=0.05
    )
    series = simulate_series(parameters, survey_days(5, 30), _LAWS, shapes=shapes)
    days = [day.isoformat() for day in series.dates]
    with tempfile.TemporaryDirectory() as name:
        paths = write_series(series, Path(name), ground_only=True)
        epochs = [Epoch(paths[day], date) for day, date in zip(days, series.dates, strict=True)]
        done = monitor_series(epochs, Path(name) / "out", _SETTINGS, roi=paths["roi"])
        zones = geopandas.read_file(done.outputs["series_zones"], layer="zones")
        surveys = geopandas.read_file(done.outputs["series_zones"], layer="series")
        compared = [float(row["compared_share"]) for row in csv.DictReader(done.outputs["coverage"].open())]
    low, high = np.asarray(series.roi).min(axis=0), np.asarray(series.roi).max(axis=0)
    grid = snapped_grid((float(low[0]), float(low[1]), float(high[0]), float(high[1])), _FINE_CELL_M)
    truth = [series.true_change(number, grid, 2) for number in range(len(days))]
    motions = [series.true_velocity(number, grid, 2) != 0 for number in range(len(_LAWS))]
    found = []
    for _, zone in zones.iterrows():
        inside = geometry_mask([zone.geometry], grid.shape, Affine(*grid.affine), invert=True)
        law, own = _own(truth[-1], motions, inside, float(zone["vol_net_m3"]))
        if not (own & inside).any():
            continue  # false zones are counted on still slopes
        rows = surveys[(surveys["zone_id"] == zone["zone_id"]) & surveys["vol_net_m3"].notna()]
        of_survey = [truth[k][inside].sum() * _FINE_CELL_M**2 for k in 1 + np.searchsorted(days[1:], rows["epoch"])]
        errors = np.abs(rows["vol_net_m3"] - of_survey) / rows["vol_err_m3"]
        moved = own & (np.abs(truth[-1]) >= _LEAST_SHARE * np.abs(truth[-1][own]).max())
        found.append(
            Ground(
                law=law,
                area=float(zone["area_m2"]),
                true_area=float(moved.sum()) * _FINE_CELL_M**2,
                volume=float(zone["vol_net_m3"]),
                true_volume=float(truth[-1][own].sum()) * _FINE_CELL_M**2,
                held=tuple((errors <= Z95).tolist()),
            )
        )
    return compared, found


def _own(truth: Float, motions: Sequence[Bool], inside: Bool, volume: float) -> tuple[int, Bool]:
    """The law that moves most of the cells ``inside``, and all cells that it moves the same way as the zone."""
    same_way = np.sign(truth) == np.sign(volume)
    law = max(range(len(motions)), key=lambda number: np.count_nonzero(motions[number] & same_way & inside))
    return law, motions[law] & same_way
