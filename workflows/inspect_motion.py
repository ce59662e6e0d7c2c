"""Motion along the surface within an inspection: measured where the ground allows it, else left out with the reason.

Whatever becomes of it, the other results of the inspection stay the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..engine.core.errors import EngineError, InputError
from ..engine.displacement.displacement import MIN_POINTS_PER_M2, Displacement, measure_displacement
from ..engine.displacement.registered import Registered
from ..engine.displacement.status import REASONS, Status
from ..engine.displacement.stored_ground import Ground
from ..engine.displacement.windows import density
from ..engine.registration.result import RegistrationResult
from ..engine.report.motion_facts import motion_facts
from ..interface.parameters import DisplacementParameters, given
from .displacement import stable_places
from .motion_memory import MotionMemory, measurable
from .pair import Cloud
from .products import displacement as files
from .products.change import Context
from .run import Run

_FAULTS = (InputError, EngineError, MemoryError, ArithmeticError, ValueError, IndexError)


@dataclass(frozen=True)
class Motion:
    """What was measured, and the error of the registration that it holds."""

    found: Displacement
    registered: Registered
    stable_given: bool


def measured_motion(
    run: Run,
    clouds: tuple[Cloud, Cloud],
    parameters: DisplacementParameters,
    registration: RegistrationResult,
    stable: Path | None,
    memory: MotionMemory,
) -> Motion | None:
    """Motion of the later of two ground clouds in one frame; None where that is not possible.

    Why it is not possible stands in the record as ``displacement_left_out``. Only cancelling ends the run from here.

    Args:
        stable: polygons of ground known to be stable; its motion is taken off all vectors.
    """
    with run.step("displacement", 0.68, 0.79, "measuring motion along the surface") as entry:
        try:
            with measurable(clouds, memory, parameters.spacing) as (first, later):
                _refuse_too_sparse(first, later)
                registered = registered_by(registration, parameters)
                places = stable_places(stable, clouds[0].crs)
                found = measure_displacement(
                    first, later, parameters, registered, places, run.progress, threads=memory.threads
                )
            _refuse_all_unseen(found)
        except _FAULTS as error:
            _leave_out(run, error)
            return None
        entry["windows"] = len(found.cell)
    return Motion(found, registered, stable is not None)


def registered_by(registration: RegistrationResult, parameters: DisplacementParameters) -> Registered:
    """The error of a registration: as the user states it, else its own; unknown where it has none."""
    stated = given(parameters.surface_error)
    if stated is not None:
        return Registered.shift(stated, registration.registration_error or stated)
    if registration.covariance is None:
        return Registered.unknown()
    return Registered(registration.covariance, np.asarray(registration.transform.centre), known=True)


def write_motion(run: Run, motion: Motion, parameters: DisplacementParameters, context: Context) -> None:
    """Write the rasters and layers; ``run`` gets their paths, the facts of the report and the main figures."""
    found = motion.found
    run.outputs |= files.write_products(found, context.crs, context.tags(), run)
    run.facts["displacement"] = motion_facts(found, parameters, motion.registered, stable_given=motion.stable_given)
    run.figures |= files.step_figures(found)
    if len(found.zones) and not motion.registered.known:
        run.progress.warning(
            "The registration's error along the surface is not known here, so that the zones that move along it may be "
            "an error of the registration; register with the method robust, or give --surface-error."
        )


def _refuse_too_sparse(first: Ground, later: Ground) -> None:
    found = density((first, later))
    if found < MIN_POINTS_PER_M2:
        raise InputError(
            f"The sparser survey has {found:.2g} ground points a m², and with less than {MIN_POINTS_PER_M2:g} the "
            "errors of displacement vectors are not reliable; survey more densely, or use displacement by itself."
        )


def _refuse_all_unseen(found: Displacement) -> None:
    status = found.vectors.status
    if found.vectors.measured.any():
        return
    counts = {reason: int((status == reason).sum()) for reason in Status}
    most = max(counts, key=lambda reason: counts[reason])
    raise InputError(f"Nowhere on the map a motion along the surface, or its absence, can be seen: {REASONS[most]}.")


def _leave_out(run: Run, error: Exception) -> None:
    sentence = str(error)
    if isinstance(error, MemoryError):
        sentence = "Memory ran out; clip the surveys to the slope or thin them."
    elif not isinstance(error, (InputError, EngineError)):
        sentence = f"It failed on this ground ({type(error).__name__}: {error}); please report it."
    run.facts["displacement_left_out"] = sentence
    run.progress.info(f"Motion along the surface was not measured. {sentence}")
