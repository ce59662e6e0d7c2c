"""Volumes of zones against the truth: how often the 95 % interval covers it, and by how much volumes lean.

Two kinds of pairs. *Grids*: a known change, gaps, errors with a known spatial correlation and a registration error that
all cells share, from which zones are found as in a real difference; many of them in little time. *Surveys*: simulated
flights over one slope, through ground extraction, registration and differencing. The truth is the simulated
displacement over the same footprint. For comparison, over the zones' own cells: errors independent from cell to
cell, and fully correlated.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from ...engine.core.arrays import Float
from ...engine.grid.grid import Grid
from ...engine.grid.partition import Partition
from ...engine.statistics.normal import Z95
from ...engine.statistics.variogram import VariogramModel
from ...engine.zones.extraction import Zones, extract_zones
from ...engine.zones.footprints import Cells, Detected, footprint_labels
from ...engine.zones.gcd_table import volume_table
from ...interface.parameters import ChangeParameters, SurveyParameters
from ...simulation.frame import Frame
from ...simulation.surveys.change import Bump, Change, Cone, Plateau, true_change_raster
from ...simulation.surveys.survey import simulate_pair
from .chain import changed, registered
from .table import Row, say

GRIDS = range(1, 31)
SURVEYS = range(1, 8)
TOTALS = 40
AMPLITUDE, AREA = (0.02, 0.30), (0.5, 20.0)
CELL, SIDE = 0.1, 40.0
ERROR, REGISTRATION = 0.035, 0.003
NOISES = {
    "independent": VariogramModel(1.0),
    "a tenth correlated over 4 m": VariogramModel(0.9, (0.1,), (4.0,)),
    "two fifths correlated over 0.8 and 5 m": VariogramModel(0.6, (0.3, 0.1), (0.8, 5.0)),
}


@dataclass(frozen=True)
class Measured:
    """A zone's volumes, m³: over its footprint and over its own cells, measured and true, with the errors stated.

    ``whole`` is the true volume of all the change that the zone lies on, None where others lie on it too.
    """

    volume: float
    true: float
    error: float
    own: float
    own_true: float
    independent: float
    correlated: float
    whole: float | None


def rows() -> list[Row]:
    """Coverage and lean, for each kind of noise and for surveys."""
    found = [_row(f"grids, errors {name}", _all_grids(model)) for name, model in NOISES.items()]
    return [*found, _totals(), _row("surveys, 0 to 80 % vegetation", _all_surveys())]


def _totals() -> Row:
    """Every fourth run without any change."""
    models = list(NOISES.values())
    covered = totals_covered(known_pair(100 + n, models[n % 3], changed=n % 4 > 0) for n in range(TOTALS))
    held, of = (sum(counts[i] for counts in covered.values()) for i in (0, 1))
    return Row(
        f"totals of {TOTALS} grids, a quarter of them unchanged: 95 % intervals that hold the truth",
        ", ".join(f"{name} {held_here} of {count}" for name, (held_here, count) in covered.items()),
        "90 to 99 %",
        "lowering and raising of cells beyond their level have no interval",
        0.9 <= held / of <= 0.99,
    )


@dataclass(frozen=True)
class Pair:
    """A measured change on a grid, what is true of it, and its zones; arrays (rows, columns), metres."""

    grid: Grid
    dz: Float
    error: Float
    truth: Float
    zones: Zones


def known_grid(seed: int, model: VariogramModel) -> list[Measured]:
    """The zones of nine changes on a grid with ``model``'s errors and a third of the cells without data."""
    pair = known_pair(seed, model)
    return _compared(pair.zones, pair.dz, pair.error, pair.truth, pair.grid, REGISTRATION)


def known_pair(seed: int, model: VariogramModel, *, changed: bool = True) -> Pair:
    """Nine changes, or none, on a grid with ``model``'s errors and a third of the cells without data."""
    rng = np.random.default_rng([seed, 21])
    frame, cells = Frame(), round(SIDE / CELL)
    grid = Grid(math.floor(frame.east / CELL) * CELL, math.floor(frame.north / CELL) * CELL, CELL, cells, cells)
    places = [
        (
            grid.west + (i + 0.5 + rng.uniform(-0.1, 0.1)) * SIDE / 3,
            grid.north - (j + 0.5 + rng.uniform(-0.1, 0.1)) * SIDE / 3,
        )
        for i in range(3)
        for j in range(3)
    ]
    local = frame.to_local(np.array([(x, y, 0.0) for x, y in places]))
    changes = [_drawn(u, v, rng) for u, v in local[:, :2].tolist()] if changed else []
    truth = true_change_raster(changes, frame, grid, 8) if changes else np.zeros(grid.shape)
    error = ERROR * np.exp(0.25 * _unit(ndimage.gaussian_filter(rng.standard_normal(grid.shape), 10)))
    noise = correlated_field(grid.shape, CELL, model, rng)
    gaps = _unit(ndimage.gaussian_filter(rng.standard_normal(grid.shape), 1.5))
    known = gaps + 0.7 * rng.standard_normal(grid.shape) > -0.5
    dz = np.where(known, truth + error * noise + REGISTRATION * rng.standard_normal(), np.nan)
    error = np.where(known, np.hypot(error, REGISTRATION), np.nan)
    with np.errstate(invalid="ignore"):
        significant = np.abs(dz) > Z95 * error
    count = np.full(grid.shape, 5)
    found = Detected(significant, Z95 * error, count)
    zones = extract_zones(_cells(dz, error, grid), found, grid, None, registration_error=REGISTRATION)
    return Pair(grid, dz, error, truth, zones)


def _cells(dz: Float, error: Float, grid: Grid) -> Cells:
    return Cells(dz, error, np.full(grid.shape, grid.cell**2), Partition(grid.shape, grid.cell))


def totals_covered(runs: Iterable[Pair]) -> dict[str, tuple[int, int]]:
    """Of each line with an interval in the summary of volumes: how often that holds the truth, of how many.

    The truth is that of the compared cells for the raw net volume, and of the footprints for the zones.
    """
    counts = {"raw net": [0, 0], "zones' lowering": [0, 0], "zones' raising": [0, 0], "zones' net": [0, 0]}
    for pair in runs:
        cells = _cells(pair.dz, pair.error, pair.grid)
        with np.errstate(invalid="ignore"):
            significant = np.abs(pair.dz) > Z95 * pair.error
        table = volume_table(cells, significant, pair.zones.volumes, pair.zones.correlation)
        named = footprint_labels(pair.zones.footprints, pair.grid.shape)
        area = pair.grid.cell**2
        of_zone = np.bincount(named.ravel(), pair.truth.ravel(), minlength=len(pair.zones.frame) + 1)[1:] * area
        sank = pair.zones.volumes.net <= 0
        known = np.isfinite(pair.dz)
        stated = {
            "raw net": (table.raw.net, table.raw_net_error, float(pair.truth[known].sum()) * area),
            "zones' lowering": (*table.zones_lowering, -float(of_zone[sank].sum())),
            "zones' raising": (*table.zones_raising, float(of_zone[~sank].sum())),
            "zones' net": (*table.zones_net, float(of_zone.sum())),
        }
        for name, (value, error, true) in stated.items():
            if error > 0:
                counts[name][0] += abs(value - true) <= Z95 * error
                counts[name][1] += 1
    return {name: (held, of) for name, (held, of) in counts.items()}


def known_survey(seed: int) -> list[Measured]:
    """Eight changes on a slope, flown over twice; default settings."""
    rng = np.random.default_rng([seed, 22])
    length, height, angle = 40.0, 18.0, 39.0
    run = height / math.tan(math.radians(angle))
    changes = [
        _drawn(
            length * (i + 0.5 + rng.uniform(-0.15, 0.15)) / 4,
            run * (j + 0.5 + rng.uniform(-0.1, 0.1)) / 2,
            rng,
            smooth=True,
        )
        for i in range(4)
        for j in range(2)
    ]
    parameters = SurveyParameters(
        seed=seed, points=200_000, length=length, height=height, angle=angle, vegetation=0.8 * (seed % 5) / 4
    )
    pair = simulate_pair(parameters, changes=tuple(changes))
    change, zones = changed(*registered(pair), ChangeParameters(adaptive=True))
    truth = pair.true_change_raster(change.grid, 8)
    return _compared(zones, change.dz, change.error, truth, change.grid, change.registration_error)


def _drawn(u: float, v: float, rng: np.random.Generator, *, smooth: bool = False) -> Change:
    area, aspect = math.exp(rng.uniform(*np.log(AREA))), rng.uniform(0.6, 1.6)
    amplitude = float(math.exp(rng.uniform(*np.log(AMPLITUDE))) * rng.choice((-1, 1)))
    radius = math.sqrt(area / math.pi)
    kind = 0 if smooth else rng.integers(3)
    if kind == 1:
        return Plateau(u, v, math.sqrt(area), amplitude, float(rng.uniform(0, 90)))
    if kind == 2:
        return Cone(u, v, 2 * radius, amplitude)
    return Bump(u, v, radius * math.sqrt(aspect), radius / math.sqrt(aspect), amplitude)


def _unit(values: Float) -> Float:
    return (values - values.mean()) / values.std()


def correlated_field(shape: tuple[int, int], cell: float, model: VariogramModel, rng: np.random.Generator) -> Float:
    """A random field (rows, columns) with the covariance of ``model`` on cells of ``cell`` metres.

    By circulant embedding (Dietrich and Newsam 1993).
    """
    field: Float = math.sqrt(model.nugget) * rng.standard_normal(shape)
    if not model.sills:
        return field
    size = tuple(fft.next_fast_len(2 * n) for n in shape)
    lags = [np.abs(np.fft.fftfreq(n, 1.0 / n)) for n in size]
    spectrum = np.maximum(fft.fft2(model.structured(np.hypot(lags[0][:, None], lags[1]) * cell)).real, 0.0)
    white = rng.standard_normal(size) + 1j * rng.standard_normal(size)
    smooth = fft.fft2(np.sqrt(spectrum / (size[0] * size[1])) * white).real
    return field + smooth[: shape[0], : shape[1]]


def _compared(zones: Zones, dz: Float, error: Float, truth: Float, grid: Grid, registration: float) -> list[Measured]:
    """All zones of a true change; those of none are counted by another benchmark."""
    area = grid.cell**2
    changes, _ = ndimage.label(truth != 0, structure=np.ones((3, 3)))
    named = footprint_labels(zones.footprints, grid.shape)
    found = []
    for number in range(1, len(zones.frame) + 1):
        own = zones.labels == number
        hit = np.unique(changes[own])
        hit = hit[hit > 0]
        if not hit.size:
            continue
        there = np.isin(changes, hit)
        alone = set(np.unique(zones.labels[there]).tolist()) <= {0, number}
        sampling = float(np.sum(error[own] ** 2 - registration**2))
        found.append(
            Measured(
                volume=float(zones.volumes.net[number - 1]),
                true=float(truth[named == number].sum() * area),
                error=float(zones.volumes.error[number - 1]),
                own=float(dz[own].sum() * area),
                own_true=float(truth[own].sum() * area),
                independent=area * math.hypot(own.sum() * registration, math.sqrt(sampling)),
                correlated=area * float(error[own].sum()),
                whole=float(truth[there].sum() * area) if alone else None,
            )
        )
    return found


def _all_grids(model: VariogramModel) -> list[Measured]:
    return [zone for seed in GRIDS for zone in known_grid(seed, model)]


def _all_surveys() -> list[Measured]:
    found = []
    for seed in SURVEYS:
        some = known_survey(seed)
        found += some
        say(f"survey {seed}: {len(some)} zones")
    return found


def _covered(volumes: Iterable[float], true: Iterable[float], errors: Iterable[float]) -> float:
    inside_interval = [abs(v - t) <= Z95 * e for v, t, e in zip(volumes, true, errors, strict=True)]
    return 100.0 * float(np.mean(inside_interval))


def _row(name: str, zones: list[Measured]) -> Row:
    true, own_true = [z.true for z in zones], [z.own_true for z in zones]
    volumes, own = [z.volume for z in zones], [z.own for z in zones]
    coverage = _covered(volumes, true, [z.error for z in zones])
    lean = 100.0 * float(np.median([z.volume / z.true - 1 for z in zones]))
    own_lean = 100.0 * float(np.median([z.own / z.own_true - 1 for z in zones]))
    single = [(z.volume, z.own, z.whole) for z in zones if z.whole is not None]
    whole, own_whole = (100.0 * float(np.median([s[i] / s[2] - 1 for s in single])) for i in (0, 1))
    relative = 100.0 * float(np.median([z.error / abs(z.volume) for z in zones]))
    naive = _covered(own, own_true, [z.independent for z in zones])
    full = _covered(own, own_true, [z.correlated for z in zones])
    return Row(
        f"volumes, {name}: 95 % interval covers the truth",
        f"{coverage:.1f} % of {len(zones)} zones; volumes lean {lean:+.1f} %, {whole:+.1f} % against the whole change; "
        f"median standard error {relative:.0f} %",
        "90 to 99 %",
        f"zones' own cells: errors independent {naive:.1f} %, fully correlated {full:.1f} %; volumes lean "
        f"{own_lean:+.1f} %, {own_whole:+.1f} % against the whole change",
        90.0 <= coverage <= 99.0,
    )
