"""How often unchanged ground exceeds the 95 % level of detection, by slope: calibrated, uncalibrated, and one level."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import shapely

from ...engine.change.difference import Areas, difference
from ...engine.change.result import Change
from ...engine.core.arrays import Float
from ...interface.parameters import ChangeParameters, SurveyParameters
from ...simulation.surveys.survey import simulate_pair
from .chain import registered_clouds
from .real_data import DENSE_HALVES, dense_cloud, split
from .slope_classes import TARGET, beyond_half, cell_shares, halves, met, text
from .table import Row, say

LIMITS = (0, 15, 30, 45, 60, 90)
CELLS = (0.1, 0.25)
FACES = ((30, 0.5), (45, 0.5), (60, 0.3), (39, 0.8))  # degrees, vegetation; each with a road, a berm and a shoulder
REAL_SEEDS = range(1, 4)
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
    cloud = dense_cloud()
    if cloud is not None:
        pairs = [Unchanged(*split(cloud, seed), 0.0) for seed in REAL_SEEDS]
        found += [_row(DENSE_HALVES, pairs, cell) for cell in CELLS]
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
        unchanged = Unchanged(*registered_clouds(pair))
        say(f"{angle} degrees: {len(unchanged.first)} ground points")
        yield unchanged


def _row(name: str, pairs: list[Unchanged], cell: float) -> Row:
    shares = {}
    for kind, parameters in _KINDS.items():
        changes = [_change(pair, parameters, cell) for pair in pairs]
        shares[kind] = cell_shares(((change, change.valid) for change in changes), LIMITS)
    own = shares.pop("calibrated")
    return Row(
        f"{name}, cells of {cell:g} m that grow: beyond the 95 % level by slope",
        text(own),
        TARGET,
        "; ".join(f"{kind}: {text(values)}" for kind, values in shares.items()),
        met(own),
    )


def _held_out(name: str, pairs: list[Unchanged], cell: float) -> Row:
    """Calibrated on the western half as if it alone were known to be stable, counted on the rest, and in turn."""
    counted = []
    for pair in pairs:
        for known, middle, western in halves(pair.first):
            change = _change(pair, _KINDS["calibrated"], cell, known)
            counted.append((change, beyond_half(change, middle, western)))
    shares = cell_shares(counted, LIMITS)
    figure = f"{name}, cells of {cell:g} m that grow"
    return Row(figure, text(shares), TARGET, "", met(shares))


def _change(pair: Unchanged, parameters: ChangeParameters, cell: float, known: shapely.Polygon | None = None) -> Change:
    values = {name: getattr(parameters, name) for name in ("calibrate", "cell_value", "threshold", "adaptive")}
    return difference(
        pair.first,
        pair.second,
        ChangeParameters(cell=cell, **values),
        registration_error=pair.registration_error,
        areas=Areas(stable=known),
    )
