"""The level of detection of M3C2 as stable ground calibrates it; the published one is in ``m3c2``.

The published level adds the registration's standard error to that of the points (Lague et al. 2013, eq. 1). As errors
of two sources they add in squares, and how well the points' scatter predicts the error of a mean depends on the ground.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import stdtrit

from ..change.measured import Measured
from ..change.plant_calibration import PATCH_M, plants_factor
from ..change.slope_calibration import ErrorModel, Samples, calibrate, patch_halves, uncalibrated, without_stable_ground
from ..change.stable_ground import StableGround, stable_ground
from ..core.arrays import Bool, Float, Index
from ..core.progress import Progress
from ..grid.partition import Partition
from ..grid.plant_cells import PlantCells
from ..statistics.layout import Layout
from ..statistics.normal import quantile
from .distances import Cylinders, Distances, level_of_detection, squared_errors
from .lattice import dominant_frame
from .spread import explained_squares, tilt_of, uneven_sampling

_PUBLISHED = "as published (Lague et al. 2013)"
_MAX_CELLS = 5_000_000


def calibrated(
    found: Distances,
    radius: float,
    *,
    slope: Float | None = None,
    given: Bool | None = None,
    uniform: bool = False,
) -> Distances:
    """``found`` with a level of detection calibrated on stable ground, as that of a difference of heights is.

    The squares of the errors of both cylinders' means, of the registration and, where the clouds know it, of the plants
    are summed. The quantile of the means' errors is Student's, of the degrees of freedom after Welch (1947,
    doi:10.1093/biomet/34.1-2.28), and a factor by slope scales them, learned on stable ground (``slope_error``). Core
    points nearer to each other than a cylinder's radius share points, and count accordingly less.

    Where it is not known what is stable, the level is the published one, or that of the summed squares where it is
    wider.

    Args:
        radius: of the cylinders, metres.
        slope: (m,) of the surface at the core points, degrees; by default that of the normals.
        given: (m,) core points on ground known to be stable; found in the distances by default.
        uniform: all has moved alike, so that nothing of it is stable.
    """
    here = np.flatnonzero(found.measured)
    if not here.size:
        return found
    sampling = sampling_errors(_taken(found.reference, here), _taken(found.moving, here), found.confidence)
    degrees = slope_of(found.normal) if slope is None else slope
    cores = _Cores(
        distance=found.distance[here],
        sampling=sampling,
        slope=degrees[here],
        plants=plant_error(found, here),
        places=_places(found.core[here], radius),
        given=None if given is None else given[here],
    )
    ground = _stable(cores, found.registration_error, uniform)
    model, factor = _model(cores, ground, found, uniform)
    scaled = model.factor(cores.slope) * sampling if model.kind == "calibrated" else sampling
    plants = 0.0 if cores.plants is None else factor * cores.plants
    level = np.full(len(found.core), np.nan)
    level[here] = quantile(found.confidence) * np.sqrt(scaled**2 + plants**2 + found.registration_error**2)
    if model.kind != "calibrated":
        level = np.fmax(level, found.level)
    with np.errstate(invalid="ignore"):
        significant = np.abs(found.distance) > level
    return replace(found, level=level, significant=significant, model=model, plants_factor=factor)


def sampling_errors(first: Cylinders, second: Cylinders, confidence: float) -> Float:
    """Standard error of the difference of two means, metres (m,), times Student's quantile over the normal one.

    So the normal quantile times it is the level of means whose scatter is estimated from so few points. The degrees
    of freedom are (a + b)² / (a² / (n1 - 1) + b² / (n2 - 1)) with a and b the squared errors of the two means.

    Where it is known how the points lie across the axis, these are of the scatter about the tilted surface, and the
    error that the tilt causes by the points' different places is added in quadrature (``m3c2_spread``). Of points that
    lie at random the mean square is the same; clustered points are not at random.
    """
    a, b = squared_errors(first, second)
    uneven: Float | float = 0.0
    if first.spread is not None and second.spread is not None:
        tilt = tilt_of(first.spread, second.spread)
        uneven = uneven_sampling(first.spread, second.spread)
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (
                np.maximum(squares - explained_squares(of.spread, tilt) / ((of.count - 1) * of.count), 0.0)
                for squares, of in ((a, first), (b, second))
                if of.spread is not None
            )
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = (a + b) ** 2 / (a**2 / (first.count - 1) + b**2 / (second.count - 1))
    student = stdtrit(np.where(np.isfinite(freedom), freedom, np.inf), (1 + confidence) / 2)
    return np.hypot(np.sqrt(a + b) * np.maximum(student / quantile(confidence), 1.0), uneven)


def slope_of(normal: Float) -> Float:
    """Degrees (m,) of the surface to the horizontal, from its normals (m, 3) of length 1; NaN where there is none."""
    steep = np.degrees(np.arccos(np.clip(np.abs(normal[:, 2]), 0.0, 1.0)))
    return np.where(normal.any(axis=1), steep, np.nan)


def level_facts(found: Distances, *, calibrate: bool) -> dict[str, Any]:
    """How the level of detection came about, for the run record; metres."""
    widest = f"{_PUBLISHED}, or of the errors' squares where wider"
    return {
        "level": "calibrated" if found.model.kind == "calibrated" else widest if calibrate else _PUBLISHED,
        "asked_for": "calibrated" if calibrate else _PUBLISHED,
        "confidence": found.confidence,
        "registration_error_m": found.registration_error,
        "plants_factor": found.plants_factor,
        **found.model.summary(),
    }


def report_level(found: Distances, progress: Progress) -> None:
    """Report what the calibration found, or why there is none."""
    for note in found.model.notes:
        progress.warning(note)
    if found.model.kind != "calibrated":
        return
    factors = ", ".join(f"{c.slope_from:g} to {c.slope_to:g}° {c.factor:.2f}" for c in found.model.classes)
    published = level_of_detection(found.reference, found.moving, found.confidence, found.registration_error)
    progress.info(
        f"The level of detection is calibrated on {found.model.stable_cells} core points of stable ground "
        f"({100 * found.model.stable_share:.0f} %); errors are multiplied, by slope: {factors or found.model.typical}. "
        f"Median {np.nanmedian(found.level):.3f} m, as published {np.median(published[found.measured]):.3f} m."
    )


@dataclass(frozen=True)
class _Places:
    """Where core points are in the plane that fits them best: the ``cell`` (m,) of a grid of ``shape``, and the
    ``square`` of ``PATCH_M`` (m,). The grid's cells are ``side`` metres wide. ``independent`` is the share of the core
    points that shares no points with others.
    """

    cell: Index
    shape: tuple[int, int]
    side: float
    square: Index
    independent: float

    @property
    def half(self) -> Bool:
        """(m,) those on the squares of one colour of a chessboard."""
        return patch_halves(Layout(self.shape), self.cell)

    def means(self, values: Float) -> Float:
        """Mean of the core points' values (m,) in each cell of the grid; NaN without any."""
        cells = self.shape[0] * self.shape[1]
        with np.errstate(invalid="ignore"):
            mean = np.bincount(self.cell, values, cells) / np.bincount(self.cell, minlength=cells)
        return mean.reshape(self.shape)


@dataclass(frozen=True)
class _Cores:
    """The measured core points; arrays (m,), metres and degrees. ``plants`` is along the normal."""

    distance: Float
    sampling: Float
    slope: Float
    plants: Float | None
    places: _Places
    given: Bool | None


def _places(core: Float, radius: float) -> _Places:
    # in the plane of the surface, where even a wall's core points lie next to each other
    local = (core - core.mean(axis=0)) @ dominant_frame(core)[:2].T
    local -= local.min(axis=0)
    # few core points far apart: larger cells do as well
    side = max(radius, math.sqrt(float(np.prod(np.maximum(local.max(axis=0), radius))) / _MAX_CELLS))
    cell, shape = _numbered(local, side)
    # squares as large as a cylinder's section: of the core points in one, each shares most of its points
    apart, _ = _numbered(local, math.sqrt(math.pi) * radius)
    square, _ = _numbered(local, PATCH_M)
    return _Places(cell, shape, side, square, len(np.unique(apart)) / len(core))


def _numbered(local: Float, side: float) -> tuple[Index, tuple[int, int]]:
    """Number of the square of ``side`` metres in which each place (m, 2), from 0 on, is; rows and columns of all."""
    column, row = (local / side).astype(np.int64).T
    shape = int(row.max()) + 1, int(column.max()) + 1
    return row * shape[1] + column, shape


def _taken(cylinders: Cylinders, here: Index) -> Cylinders:
    spread = None if cylinders.spread is None else cylinders.spread.taken(here)
    return Cylinders(cylinders.count[here], cylinders.mean[here], cylinders.std[here], spread=spread)


def plant_error(found: Distances, here: Index) -> Float | None:
    """Error (m,) of the distances ``here`` by plants, m, along the normals; None where no cloud states it."""
    values = [cloud.value[here] for cloud in (found.reference, found.moving) if cloud.value is not None]
    if not values:
        return None
    upright: Float = np.abs(found.normal[here, 2])
    return upright * np.sqrt(np.sum(np.square(values), axis=0))


def _stable(cores: _Cores, registration_error: float, uniform: bool) -> StableGround:
    """The stable cells of the grid in which the core points are."""
    places = cores.places
    # only cells whose core points are all given
    given = None if cores.given is None else places.means(cores.given.astype(np.float64)) == 1.0
    dz = places.means(cores.distance)
    measured = Measured(
        dz,
        places.means(cores.sampling),
        places.means(cores.slope),
        Partition((dz.shape[0], dz.shape[1]), places.side),
        None if cores.plants is None else PlantCells(np.zeros(dz.shape), places.means(cores.plants)),
    )
    return stable_ground(measured, registration_error=registration_error, uniform=uniform, given=given)


def _model(cores: _Cores, ground: StableGround, found: Distances, uniform: bool) -> tuple[ErrorModel, float]:
    """The factors by slope, and that of the errors by plants."""
    if uniform:
        return replace(uncalibrated(), notes=(_left("all of the ground has moved alike"),)), 1.0
    if not ground.settled:
        model = without_stable_ground(ground.changed_share, ground.looks_stable)
        looks = f"{100 * ground.looks_stable:.0f} %"
        why = f"more than a third of the compared ground has changed (only {looks} looks stable)"
        return replace(model, notes=(_left(why),)), 1.0
    stable = ground.stable.ravel()[cores.places.cell]
    known = {"registration_error": found.registration_error, "confidence": found.confidence}
    samples = Samples(cores.distance, cores.sampling, cores.slope, stable, plants=cores.plants, half=cores.places.half)
    model = calibrate(samples, independent=cores.places.independent, **known)
    if model.kind != "calibrated":
        return replace(model, kind="uncalibrated", typical=1.0, notes=(_left(model.why),)), 1.0
    model = replace(model, changed_share=None if cores.given is not None else ground.changed_share)
    if cores.plants is None:
        return model, 1.0
    scaled = model.factor(cores.slope) * cores.sampling
    return model, plants_factor(cores.distance, scaled, cores.plants, stable, cores.places.square, **known)


def _left(why: str) -> str:
    return (
        f"The level of detection could not be calibrated, because {why}; it is the published one (Lague et al. 2013), "
        "or that of the errors summed in squares where it is wider; give an area known to be stable."
    )
