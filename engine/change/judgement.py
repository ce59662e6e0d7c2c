"""From a raw difference to calibrated errors, a level of detection and significant cells."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...interface.parameters import GridChangeParameters
from ..core.arrays import Float
from ..grid.blocks import Blocks, first_cells
from ..grid.grid import on_grid
from ..grid.plant_cells import PlantCells
from .plant_calibration import plants_factor, squares_of
from .size_calibration import widening_by_size
from .slope_calibration import ErrorModel, calibrate, patch_halves, uncalibrated, without_stable_ground
from .stable_ground import stable_ground
from .thresholds import Decision, decide


@dataclass(frozen=True)
class Judgement:
    """A difference with its errors; arrays (rows, columns), metres, NaN where not compared.

    ``dz`` is along the direction asked for, and so are ``error`` and its parts: ``sampling``, that of the points after
    calibration, ``plants``, and ``registration_error``, which all cells share. ``plants_factor`` is by what the stated
    errors by plants were multiplied.
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
    dz: Float,
    sampling: Float,
    slope: Float,
    cell: float,
    parameters: GridChangeParameters,
    *,
    registration_error: float,
    uniform: bool = False,
    given: NDArray[np.bool_] | None = None,
    block: Blocks | None = None,
    size: Float | None = None,
    plants: PlantCells | None = None,
) -> Judgement:
    """Calibrate the errors of ``dz`` on stable ground and tell the level of detection and what is beyond it.

    The error is, in quadrature, that of the points and that of the plants, both of which the calibration scales, and
    the registration's.

    Along the slope's normal a change is dz cos(slope): the distance of two parallel planes, one dz above the other. A
    horizontal shift by dx, which a vertical difference shows as dx tan(slope), then shows as dx sin(slope), never more
    than itself.

    Args:
        dz: vertical change, metres, NaN where not compared.
        sampling: its standard error from the points' scatter, metres.
        slope: degrees to the horizontal, NaN where unknown.
        cell: side of a cell, metres.
        registration_error: standard error in height that all cells share, metres.
        uniform: the whole overlap has moved alike, so that there is no stable ground in it.
        given: cells known to be stable. Slopes beyond theirs are calibrated on stable cells found.
        block: number of the group that a cell is one with (-1: none), where cells grew.
        size: side of the grown cell, metres, by which errors are calibrated, too.
        plants: error of the heights by plants.
    """
    valid = np.isfinite(dz)
    if parameters.direction == "normal":
        cosine = np.cos(np.radians(slope))
        dz, sampling = dz * cosine, sampling * cosine
        plants = None if plants is None else plants.scaled(cosine)
        valid = np.isfinite(dz)
        if valid.any():
            registration_error *= float(np.median(cosine[valid]))
    by_plants = None if plants is None else plants.error
    first = np.ones(dz.shape, dtype=bool) if block is None else first_cells(block)
    # a grown cell is one of those compared, however many cells of the grid it holds
    here, one_each = np.flatnonzero(valid), np.flatnonzero(valid & first)
    ground = stable_ground(
        dz,
        sampling,
        slope,
        cell,
        registration_error=registration_error,
        plants=by_plants,
        uniform=uniform,
        given=given,
        block=block,
    )
    stable = ground.stable
    model = uncalibrated()
    if not ground.settled and parameters.calibrate:
        model = without_stable_ground(ground.changed_share, ground.looks_stable)
    elif parameters.calibrate and not uniform:
        if size is not None:
            sampling = sampling * widening_by_size(
                dz,
                sampling,
                size,
                stable & first,
                registration_error=registration_error,
                confidence=parameters.confidence,
                plants=by_plants,
            )
        model = calibrate(
            dz.ravel()[one_each],
            sampling.ravel()[one_each],
            slope.ravel()[one_each],
            stable.ravel()[one_each],
            registration_error=registration_error,
            confidence=parameters.confidence,
            plants=None if by_plants is None else by_plants.ravel()[one_each],
            half=patch_halves(dz.shape).ravel()[one_each],
        )
        model = replace(model, changed_share=ground.changed_share if given is None else None)
    scaled = on_grid(here, model.factor(slope.ravel()[here]) * sampling.ravel()[here], dz.shape)
    factor = 1.0
    if plants is not None and parameters.calibrate and not uniform and ground.settled:
        factor = plants_factor(
            dz,
            scaled,
            plants.error,
            stable & first,
            squares_of(dz.shape, cell),
            registration_error=registration_error,
            confidence=parameters.confidence,
        )
        plants = plants.scaled(factor)
        by_plants = plants.error
    error = np.hypot(scaled, registration_error)
    if by_plants is not None:
        error = np.hypot(error, by_plants)
    decision = decide(dz, error, parameters, block)
    return Judgement(dz, error, decision, model, stable, registration_error, scaled, plants, factor)
