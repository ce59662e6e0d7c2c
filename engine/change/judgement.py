"""From a raw difference to calibrated errors, a level of detection and significant cells."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from ...interface.parameters import GridChangeParameters
from ..core.arrays import Float
from ..grid.grid import on_grid
from ..grid.plant_cells import PlantCells
from .measured import Measured
from .plant_calibration import plants_factor, squares_of
from .size_calibration import widening_by_size
from .slope_calibration import ErrorModel, Samples, calibrate, patch_halves, uncalibrated, without_stable_ground
from .stable_ground import stable_ground
from .thresholds import Decision, decide


@dataclass(frozen=True)
class Judgement:
    """A difference with its errors; arrays as in ``Measured``, metres, NaN where not compared.

    ``dz`` is along the direction asked for, and so are ``error`` and its parts: ``sampling``, that of the points after
    calibration, ``plants``, and ``registration_error``, which all cells share. ``plants_factor`` is the factor
    of the stated errors by plants.
    """

    dz: Float
    error: Float
    decision: Decision
    model: ErrorModel
    stable: NDArray[np.bool_]
    registration_error: float
    sampling: Float
    plants: PlantCells | None
    plants_factor: float = 1.0


def judge(
    measured: Measured,
    parameters: GridChangeParameters,
    *,
    registration_error: float,
    uniform: bool = False,
    given: NDArray[np.bool_] | None = None,
) -> Judgement:
    """Calibrate the errors of a vertical change on stable ground and derive the level of detection and what exceeds it.

    The error is, in quadrature, that of the points and that of the plants, both of which the calibration scales, and
    the registration's. Errors of grown cells are calibrated by their size, too.

    Along the slope's normal a change is dz cos(slope): the distance of two parallel planes, one dz above the other. A
    horizontal shift by dx, which a vertical difference shows as dx tan(slope), then shows as dx sin(slope), never more
    than itself.

    Args:
        registration_error: standard error in height that all cells share, metres.
        uniform: the whole overlap has moved alike, so that there is no stable ground in it.
        given: cells (rows, columns) known to be stable. Slopes beyond theirs are calibrated on stable cells found.
    """
    if parameters.direction == "normal":
        measured = measured.along_normal()
        valid = np.isfinite(measured.dz)
        if valid.any():
            registration_error *= float(np.median(np.cos(np.radians(measured.slope[valid]))))
    ground = stable_ground(measured, registration_error=registration_error, uniform=uniform, given=given)
    known: _Known = {"registration_error": registration_error, "confidence": parameters.confidence}
    partition, factor = measured.partition, 1.0
    # a grown cell is one of those compared, however many cells of the grid it holds
    stable = partition.one_each(ground.stable)
    model = uncalibrated()
    if not ground.settled and parameters.calibrate:
        model = without_stable_ground(ground.changed_share, ground.looks_stable)
    elif parameters.calibrate and not uniform:
        if partition.grown:
            measured = replace(measured, sampling=measured.sampling * widening_by_size(measured, stable, **known))
        model = _calibrated(measured, stable, known)
        model = replace(model, changed_share=ground.changed_share if given is None else None)
    dz, plants = measured.dz, measured.plants
    scaled = _scaled(measured, model)
    if plants is not None and parameters.calibrate and not uniform and ground.settled:
        factor = plants_factor(dz, scaled, plants.error, stable, squares_of(partition.layout, partition.cell), **known)
        plants = plants.scaled(factor)
        if factor == 0.0 and model.typical == 1.0:
            # held at 1 because vegetation covers all, and alone as large as the changes of stable ground
            measured = replace(measured, plants=plants)
            model = replace(_calibrated(measured, stable, known), changed_share=model.changed_share)
            scaled = _scaled(measured, model)
    error = np.hypot(scaled, registration_error)
    if plants is not None:
        error = np.hypot(error, plants.error)
    decision = decide(dz, error, parameters, partition)
    return Judgement(dz, error, decision, model, ground.stable, registration_error, scaled, plants, factor)


def _scaled(measured: Measured, model: ErrorModel) -> Float:
    """The sampling error as the model has it, an array as in ``Measured``."""
    here = np.flatnonzero(np.isfinite(measured.dz))
    scaled = model.factor(measured.slope.ravel()[here]) * measured.sampling.ravel()[here]
    return on_grid(here, scaled, measured.dz.shape)


class _Known(TypedDict):
    """What every calibration asks for."""

    registration_error: float
    confidence: float


def _calibrated(measured: Measured, stable: NDArray[np.bool_], known: _Known) -> ErrorModel:
    """The factor by slope, of one cell of each part."""
    here = np.flatnonzero(measured.partition.one_each(np.isfinite(measured.dz)))
    half, plants = patch_halves(measured.partition.layout, here), measured.by_plants
    samples = Samples(
        measured.dz.ravel()[here],
        measured.sampling.ravel()[here],
        measured.slope.ravel()[here],
        stable.ravel()[here],
        plants=None if plants is None else plants.ravel()[here],
        half=half,
    )
    return calibrate(samples, **known)
