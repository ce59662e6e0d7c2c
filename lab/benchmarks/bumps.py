"""Thirty bumps and hollows put into real airborne strips where nothing moved: found, volumes, registration.

Five times six of them, 16 m wide and 0.2 to 0.5 m high, at random places; once in the later of two strips of one flight
(``strips``), registered to the earlier before, and once in one half of the points of a single strip. There the true
transform is the identity; between two strips it is known as well as they are registered without bumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from ...engine.change.difference import difference
from ...engine.core.arrays import Float
from ...engine.grid.grid import Grid
from ...engine.registration.register import register
from ...engine.statistics.normal import Z95
from ...engine.zones.change_zones import change_zones
from ...engine.zones.footprints import footprint_labels
from ...interface.parameters import ChangeParameters, RegistrationParameters
from .strips import FILE, HEIGHTS, RADIUS, Strips, load, with_bumps
from .table import Row, say

LAYOUTS = range(201, 206)
PARTS = 5
"""Points along each side of a cell at which the true height of a bump is taken."""
MAX_ERROR_MM = 2.0
"""Median error of the registration."""
HELD = (0.90, 0.99)


@dataclass(frozen=True)
class Found:
    """Of one layout: bumps found of how many, false zones, footprints whose interval holds, of how many, the ratios of
    measured to true volume, and how far the registration with bumps is off, mm: in space and in height.
    """

    hit: int
    bumps: int
    false: int
    held: int
    zones: int
    ratios: tuple[float, ...]
    off: float
    off_height: float
    stated: float


def rows() -> list[Row]:
    """Both kinds of pairs; none without the file."""
    if not FILE.exists():
        return []
    strips = load()
    return [*_rows("two strips", strips), *_rows("halves of one strip", halves(strips))]


def halves(strips: Strips) -> Strips:
    """The first strip's points dealt out at random: two surveys of the same ground in the same coordinates."""
    chosen = np.random.default_rng(31).random(len(strips.first)) < 0.5
    first, second = strips.first[chosen], strips.first[~chosen]
    return Strips(first, second, second, 0.0)


def measured(strips: Strips, layout: int) -> Found:
    """Registration, change and zones of the strips with the bumps of ``layout``, at the defaults."""
    moved, places = with_bumps(strips, layout)
    found = register(strips.first, moved, RegistrationParameters())
    off = found.transform.apply(strips.registered) - strips.registered
    change = difference(
        strips.first,
        found.transform.apply(moved),
        ChangeParameters(),
        registration_error=found.registration_error,
    )
    zones = change_zones(change)
    named = footprint_labels(zones.footprints, change.grid.shape)
    area = change.grid.cell**2
    truth = true_heights(places, change.grid)
    true = np.bincount(named.ravel(), truth.ravel(), minlength=len(zones.frame) + 1)[1:] * area
    shapes = zones.frame.geometry
    near = shapely.union_all([shapely.Point(*place).buffer(RADIUS) for place in places])
    real = np.asarray(shapes.intersects(near), dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = (zones.volumes.net / true)[real]
    return Found(
        hit=sum(bool(shapes.intersects(shapely.Point(*place).buffer(RADIUS / 2)).any()) for place in places),
        bumps=len(places),
        false=int((~real).sum()),
        held=int((np.abs(zones.volumes.net - true) <= Z95 * zones.volumes.error).sum()),
        zones=len(zones.frame),
        ratios=tuple(ratios.tolist()),
        off=1000 * float(np.sqrt(np.mean(np.sum(off**2, axis=1)))),
        off_height=1000 * float(np.sqrt(np.mean(off[:, 2] ** 2))),
        stated=1000 * found.registration_error,
    )


def true_heights(places: Float, grid: Grid) -> Float:
    """Mean height of the bumps at ``places`` (6, 2) over each cell (rows, columns), m."""
    steps = (np.arange(PARTS) + 0.5) / PARTS
    x = (grid.west + (np.arange(grid.columns)[:, None] + steps) * grid.cell).ravel()
    y = (grid.north - (np.arange(grid.rows)[:, None] + steps) * grid.cell).ravel()
    total = np.zeros((len(y), len(x)))
    for place, height in zip(places, HEIGHTS, strict=True):
        rows, columns = (np.flatnonzero(np.abs(v - p) < RADIUS) for v, p in ((y, place[1]), (x, place[0])))
        away = np.hypot(x[columns] - place[0], (y[rows] - place[1])[:, None])
        bump = np.where(away < RADIUS, height * np.cos(np.pi * away / (2 * RADIUS)) ** 2, 0.0)
        total[np.ix_(rows, columns)] += bump
    return total.reshape(grid.rows, PARTS, grid.columns, PARTS).mean(axis=(1, 3))


def _rows(name: str, strips: Strips) -> list[Row]:
    found = []
    for layout in LAYOUTS:
        found.append(measured(strips, layout))
        say(f"{name}, layout {layout}: {found[-1]}")
    return table(name, found)


def table(name: str, found: Sequence[Found]) -> list[Row]:
    """The figures of all layouts."""
    hit, bumps, false, held, zones = (
        sum(getattr(f, key) for f in found) for key in ("hit", "bumps", "false", "held", "zones")
    )
    off, height = (np.array([getattr(f, key) for f in found]) for key in ("off", "off_height"))
    ratios = np.array([ratio for f in found for ratio in f.ratios])
    share = held / zones if zones else 0.0
    return [
        Row(
            f"{bumps} bumps and hollows in real ground, {name}",
            f"{hit} found, {false} false zones",
            "all, 0 false",
            "",
            hit == bumps and not false,
        ),
        Row(
            f"footprints whose 95 % interval holds the truth, {name}",
            f"{held} of {zones} ({100 * share:.1f} %)",
            f"{100 * HELD[0]:g} to {100 * HELD[1]:g} %",
            f"volumes lean {100 * (np.median(ratios) - 1):+.1f} %" if len(ratios) else "",
            bool(HELD[0] <= share <= HELD[1]),
        ),
        Row(
            f"registration with the bumps in, median error, {name}",
            f"{np.median(off):.1f} mm, in height {np.median(height):.1f} (largest {off.max():.1f} and "
            f"{height.max():.1f})",
            f"{MAX_ERROR_MM:g} mm",
            f"standard error of a height stated {np.median([f.stated for f in found]):.1f} mm",
            bool(np.median(off) <= MAX_ERROR_MM),
        ),
    ]
