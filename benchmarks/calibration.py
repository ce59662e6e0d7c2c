"""How often unchanged ground exceeds the 95 % level of detection, by slope: calibrated, uncalibrated, and one level."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from ..engine.change.difference import Areas, difference
from ..engine.change.result import Change
from ..engine.core.arrays import Float
from ..engine.ground.filtering import ground_mask
from ..engine.pointcloud.reading import read_cloud
from ..engine.registration.register import register
from ..interface.parameters import (
    ChangeParameters,
    GroundParameters,
    InputParameters,
    RegistrationParameters,
    SurveyParameters,
)
from ..simulation.surveys.survey import simulate_pair
from .controlled_test import inside
from .registration import REAL, REAL_CRS
from .table import Row

CLASSES = (0, 15, 30, 45, 60, 90)
CELLS = (0.1, 0.25)
FACES = ((30, 0.5), (45, 0.5), (60, 0.3), (39, 0.8))  # degrees, vegetation; each with a road, a berm and a shoulder
REAL_SEEDS = range(1, 4)
LEAST_CELLS = 200  # their share beyond is known to 1.5 %
TARGET = "3 to 7 % in every class"
_KINDS = {
    "calibrated": ChangeParameters(adaptive=True),
    "uncalibrated": ChangeParameters(adaptive=True, calibrate=False),
    "cells of one size": ChangeParameters(adaptive=False),
    "uncalibrated cells of one size": ChangeParameters(adaptive=False, calibrate=False),
    "as published (mean height)": ChangeParameters(adaptive=False, calibrate=False, cell_value="mean"),
    "0.11 m everywhere, cells of one size": ChangeParameters(adaptive=False, threshold="propagated"),
}
"""The first is the default; cells grow in the first two."""


@dataclass(frozen=True)
class Unchanged:
    """Two registered ground clouds of one surface (n, 3), and the standard error of their registration, metres."""

    first: Float
    second: Float
    registration_error: float


def rows() -> list[Row]:
    """Exceedances of simulated surveys as the whole flow delivers them, and of a real cloud's halves."""
    simulated = [*_simulated()]
    found = [_row("simulated, ground extracted and registered", simulated, cell) for cell in CELLS]
    found += [_held_out("simulated, calibrated on one half of the slope, counted on the other", simulated, CELLS[1])]
    if REAL.exists():
        halves = [*_halves()]
        found += [_row("real cloud (392 points/m²) split in two halves", halves, cell) for cell in CELLS]
    return found


def _simulated() -> Iterator[Unchanged]:
    for number, (angle, vegetation) in enumerate(FACES, 1):
        parameters = SurveyParameters(
            seed=number,
            points=500_000,
            length=40.0,
            height=16.0,
            angle=float(angle),
            benches=1,
            vegetation=vegetation,
            amplitude=0.0,
            offset=0.05,
        )
        pair = simulate_pair(parameters, roi_buffer=3.0)
        clouds = [cloud.xyz[inside(cloud.xyz, pair)] for cloud in (pair.first, pair.second)]
        first, second = (xyz[ground_mask(xyz, GroundParameters())] for xyz in clouds)
        registration = register(first, second, RegistrationParameters())
        print(f"  {angle} degrees: {len(first)} ground points", file=sys.stderr, flush=True)
        yield Unchanged(first, registration.transform.apply(second), registration.registration_error)


def _halves() -> Iterator[Unchanged]:
    cloud = read_cloud(REAL, InputParameters(crs=REAL_CRS)).xyz
    for seed in REAL_SEEDS:
        half = np.random.default_rng(seed).permutation(len(cloud)) < len(cloud) // 2
        yield Unchanged(cloud[half], cloud[~half], 0.0)


def _row(name: str, pairs: list[Unchanged], cell: float) -> Row:
    shares = {kind: _shares([_change(p, parameters, cell) for p in pairs]) for kind, parameters in _KINDS.items()}
    own = shares.pop("calibrated")
    return Row(
        f"{name}, cells of {cell:g} m that grow: beyond the 95 % level by slope",
        _text(own),
        TARGET,
        "; ".join(f"{kind}: {_text(values)}" for kind, values in shares.items()),
        all(0.03 <= share <= 0.07 for share in own.values()),
    )


def _held_out(name: str, pairs: list[Unchanged], cell: float) -> Row:
    """Calibrated on the western half as if it alone were known to be stable, counted on the rest, and in turn."""
    counted = []
    for pair in pairs:
        west, south = pair.first[:, :2].min(axis=0)
        east, north = pair.first[:, :2].max(axis=0)
        middle = float(np.median(pair.first[:, 0]))
        for known in (shapely.box(west, south, middle, north), shapely.box(middle, south, east, north)):
            change = _change(pair, _KINDS["calibrated"], cell, known)
            columns = change.grid.west + (np.arange(change.grid.columns) + 0.5) * cell
            other = columns > middle if known.bounds[0] < middle else columns < middle
            counted.append((change, np.broadcast_to(other, change.grid.shape)))
    shares = _shares([change for change, _ in counted], [where for _, where in counted])
    return Row(
        f"{name}, cells of {cell:g} m that grow",
        _text(shares),
        TARGET,
        "",
        all(0.03 <= share <= 0.07 for share in shares.values()),
    )


def _change(pair: Unchanged, parameters: ChangeParameters, cell: float, known: shapely.Polygon | None = None) -> Change:
    values = {name: getattr(parameters, name) for name in ("calibrate", "cell_value", "threshold", "adaptive")}
    return difference(
        pair.first,
        pair.second,
        ChangeParameters(cell=cell, **values),
        registration_error=pair.registration_error,
        areas=Areas(stable=known),
    )


def _shares(changes: list[Change], where: list[NDArray[np.bool_]] | None = None) -> dict[str, float]:
    """Share of significant cells by class of slope, all surveys' cells together; a grown cell is one of them."""
    slopes, beyond = [], []
    for number, change in enumerate(changes):
        counted = change.valid if where is None else change.valid & where[number]
        counted = change.partition.middles(counted)
        slopes.append(change.slope[counted])
        beyond.append(change.significant[counted])
    slope, significant = np.concatenate(slopes), np.concatenate(beyond)
    shares = {}
    for low, high in pairwise(CLASSES):
        cells = (slope >= low) & (slope < high)
        if np.count_nonzero(cells) >= LEAST_CELLS:
            shares[f"{low}-{high}°"] = float(significant[cells].mean())
    return shares


def _text(shares: dict[str, float]) -> str:
    return ", ".join(f"{name} {100 * share:.1f} %" for name, share in shares.items())
