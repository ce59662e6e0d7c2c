"""Two airborne strips of one gullied hillside, flown at once: nothing moved between them, but what was put in.

The strips are point sources 8706 and 8707 of ``santa_cruz_gullies.laz``, which is measured where it lies next to
the checkout (``../shared/data``). Zones are counted at the cell that the clouds choose and at given ones; the shares
beyond the level by slope, also where one half (west or east) calibrates and the other is counted. Then six bumps and
hollows, 16 m wide and 0.2 to 0.5 m high, are put into the second strip.
"""

from __future__ import annotations

from dataclasses import dataclass

import laspy
import numpy as np
import shapely
from scipy.spatial import cKDTree

from ...engine.change.coverage import seen
from ...engine.change.difference import Areas, difference
from ...engine.change.result import Change
from ...engine.core.arrays import Bool, Float
from ...engine.registration.register import register
from ...engine.zones.change_zones import change_zones
from ...interface.parameters import ChangeParameters, RegistrationParameters
from .real_data import DATA
from .slope_classes import TARGET, beyond_half, cell_shares, halves, met, text
from .table import Row

FILE = DATA / "terrain" / "santa_cruz_gullies.laz"
SOURCES = (8706, 8707)
CELLS = (0.0, 0.2, 0.25, 0.4, 0.5, 1.0, 2.0)
"""Sides (m); 0: as the clouds choose."""
HEIGHTS = (0.2, -0.2, 0.3, -0.35, 0.5, -0.5)
RADIUS, MIN_DISTANCE = 8.0, 22.0


@dataclass(frozen=True)
class Strips:
    """Points (n, 3) of both strips, the second as it is and registered to the first, and the registration's error."""

    first: Float
    second: Float
    registered: Float
    registration_error: float


def rows() -> list[Row]:
    """Zones, shares beyond the level and compared ground; none without the file."""
    if not FILE.exists():
        return []
    strips = load()
    moved, places = with_bumps(strips)
    found = []
    for cell in CELLS:
        name = f"cells of {cell:g} m" if cell else "cells as chosen"
        change = _change(strips, strips.registered, cell)
        plain = _change(strips, strips.second, cell, registered=False)
        count, unregistered = (len(change_zones(c).frame) for c in (change, plain))
        found.append(Row(f"zones, {name}", str(count), "0", f"not registered: {unregistered}", count == 0))
        compared = seen(change).share_of_both
        found.append(
            Row(f"compared of what both reach, {name}", f"{100 * compared:.0f} %", "85 %", "", compared >= 0.85)
        )
        shares = cell_shares([(change, change.valid)])
        other = cell_shares(_halves(strips, cell))
        found.append(
            Row(
                f"beyond the 95 % level, {name}",
                text(shares),
                TARGET,
                f"in the other half: {text(other)}",
                met(shares, other),
            )
        )
        zones = change_zones(_change(strips, moved, cell)).frame.geometry
        hit = sum(bool(zones.intersects(shapely.Point(*p).buffer(RADIUS / 2)).any()) for p in places)
        near = shapely.union_all([shapely.Point(*p).buffer(RADIUS) for p in places])
        false = int((~zones.intersects(near)).sum())
        value = f"{hit} of {len(places)} found, {false} false"
        found.append(Row(f"bumps put in, {name}", value, "6 of 6, 0 false", "", hit == len(places) and not false))
    return found


def load() -> Strips:
    """The strips, in metres from a corner of the first."""
    cloud = laspy.read(FILE)
    xyz, source = np.asarray(cloud.xyz, dtype=np.float64), np.asarray(cloud.point_source_id)
    first, second = (xyz[source == number] for number in SOURCES)
    corner = np.append(np.floor(first[:, :2].min(axis=0)), 0.0)
    first, second = first - corner, second - corner
    found = register(first, second, RegistrationParameters())
    return Strips(first, second, found.transform.apply(second), found.registration_error)


def with_bumps(strips: Strips, seed: int = 0) -> tuple[Float, Float]:
    """The registered strip with bumps and hollows, (n, 3), and their places (6, 2), where both have points."""
    random = np.random.default_rng(seed)
    trees = [cKDTree(cloud[:, :2]) for cloud in (strips.first, strips.registered)]
    places: list[Float] = []
    while len(places) < len(HEIGHTS):
        place = strips.first[random.integers(len(strips.first)), :2]
        angle, reach = random.uniform(0, 2 * np.pi, 200), RADIUS * np.sqrt(random.uniform(0, 1, 200))
        around = place + np.column_stack([np.cos(angle), np.sin(angle)]) * reach[:, None]
        covered = all((tree.query(around)[0] < 1.2).mean() >= 0.95 for tree in trees)
        if covered and all(np.hypot(*(place - other)) >= MIN_DISTANCE for other in places):
            places.append(place)
    moved = strips.registered.copy()
    for place, height in zip(places, HEIGHTS, strict=True):
        away = np.hypot(*(moved[:, :2] - place).T)
        inside = away < RADIUS
        moved[inside, 2] += height * np.cos(np.pi * away[inside] / (2 * RADIUS)) ** 2
    return moved, np.array(places)


def _change(
    strips: Strips, second: Float, cell: float, *, registered: bool = True, stable: shapely.Polygon | None = None
) -> Change:
    error = strips.registration_error if registered else 0.0
    return difference(
        strips.first, second, ChangeParameters(cell=cell), registration_error=error, areas=Areas(stable=stable)
    )


def _halves(strips: Strips, cell: float) -> list[tuple[Change, Bool]]:
    """Calibrated on the western half as if it alone were stable, with the cells of the other; and in turn."""
    found = []
    for known, middle, western in halves(strips.first, 50.0):
        change = _change(strips, strips.registered, cell, stable=known)
        found.append((change, beyond_half(change, middle, western)))
    return found
