"""What zones did, as a step of ``inspect`` and ``change``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..engine.change.result import Change
from ..engine.core.arrays import Float
from ..engine.core.errors import InputError
from ..engine.displacement.displacement import Displacement, measure_displacement
from ..engine.displacement.registered import Registered
from ..engine.pointcloud.cloud import PointCloud
from ..engine.zones.change_movements import Motion, moved_zones
from ..engine.zones.change_zones import change_zones
from ..engine.zones.extraction import Origin, Zones
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
    first, later = surveys.first, surveys.later
    if not isinstance(first, PointCloud) or not isinstance(later, PointCloud):
        run.progress.warning(
            "What the zones did is not said: the ground of both surveys is too large to be held in memory; give a "
            "region of interest around a part of the slope."
        )
        return None
    parameters, registered = settings.displacement, surveys.registered
    with run.step("movement", 0.5, 0.55, "measuring what the zones did") as entry:
        if not registered.known:
            run.progress.warning(
                "The registration's error along the surface is not known here and taken as 0 in what the zones did."
            )
        if vectors is None:
            try:
                vectors = measure_displacement(first.xyz, later.xyz, parameters, registered, progress=run.progress)
            except InputError as error:
                run.progress.warning(f"What the zones did is not said. {error}")
                return None
        origin = Origin(context.dates, context.method, context.run_id)
        found = change_zones(
            change, context.crs, settings.zones, epochs=context.dates, method=context.method, run_id=context.run_id
        )
        zones = moved_zones(
            found,
            change,
            Motion(vectors, (first.xyz, later.xyz), registered, parameters.largest_motion),
            settings.zones,
            confidence=settings.movement.movement_confidence,
            origin=origin,
            progress=run.progress,
        )
        entry["zones"] = len(zones.frame)
    return zones
