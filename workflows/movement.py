"""What zones did, as a step of ``inspect`` and ``change``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from ..engine.change.result import Change
from ..engine.core.arrays import Float
from ..engine.core.errors import InputError
from ..engine.displacement.displacement import Displacement, measure_displacement
from ..engine.displacement.registered import Registered
from ..engine.displacement.stored_ground import Ground
from ..engine.pointcloud.cloud import PointCloud
from ..engine.zones.change_movements import Motion, moved_zones
from ..engine.zones.change_zones import change_zones
from ..engine.zones.extraction import Origin, Zones
from .motion_memory import MotionMemory, measurable
from .pair import Cloud
from .products.change import Context
from .run import Run
from .settings import Settings


@dataclass(frozen=True)
class Surveys:
    """Ground of two surveys in one frame, and the error of what registered them.

    ``covariance`` (6, 6) is of a turn about ``centre`` and a shift; None where it is not known.
    """

    first: Cloud
    later: Cloud
    covariance: Float | Sequence[Sequence[float]] | None = None
    centre: Float | None = None

    @property
    def registered(self) -> Registered:
        if self.covariance is None or self.centre is None:
            return Registered.unknown()
        return Registered(np.array(self.covariance, dtype=np.float64), np.asarray(self.centre), known=True)


def moved_zones_of(
    run: Run,
    change: Change,
    surveys: Surveys,
    context: Context,
    settings: Settings,
    vectors: Displacement | None = None,
) -> Zones | None:
    """The zones of a change with what each did; None where that is not asked for or cannot be seen.

    Args:
        vectors: motion along the surface of these surveys; None: it is measured here, at the default settings.
    """
    if not settings.movement.movement:
        return None
    registered, largest = surveys.registered, settings.displacement.largest_motion
    with run.step("movement", 0.5, 0.55, "measuring what the zones did") as entry:
        if not registered.known:
            run.progress.warning(
                "The registration's error along the surface is not known here and taken as 0 in what the zones did."
            )
        memory = MotionMemory.of(settings.change.memory_limit)
        try:
            with _ground(surveys, memory, settings.displacement.spacing) as clouds:
                if vectors is None:
                    vectors = measure_displacement(
                        *clouds, settings.displacement, registered, progress=run.progress, threads=memory.threads
                    )
                zones = _moved(run, change, Motion(vectors, clouds, registered, largest), context, settings)
        except InputError as error:
            run.progress.warning(f"What the zones did is not said. {error}")
            return None
        entry["zones"] = len(zones.frame)
    return zones


@contextmanager
def _ground(surveys: Surveys, memory: MotionMemory, spacing: float) -> Iterator[tuple[Ground, Ground]]:
    """The points of both surveys; those on the disk are sorted there while they are in use."""
    first, later = surveys.first, surveys.later
    if isinstance(first, PointCloud) and isinstance(later, PointCloud):
        yield first.xyz, later.xyz
        return
    with measurable((first, later), memory, spacing) as clouds:
        yield clouds


def _moved(run: Run, change: Change, motion: Motion, context: Context, settings: Settings) -> Zones:
    found = change_zones(
        change, context.crs, settings.zones, epochs=context.dates, method=context.method, run_id=context.run_id
    )
    return moved_zones(
        found,
        change,
        motion,
        settings.zones,
        confidence=settings.movement.movement_confidence,
        origin=Origin(context.dates, context.method, context.run_id),
        progress=run.progress,
    )
