"""The times of layers as the project's time, so that the temporal controller has its range and its step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from qgis.core import QgsDateTimeRange, QgsProject, QgsUnitTypes


def project_time() -> Callable[[Any, QgsProject], None]:
    """What each of some rasters is given to after its loading: the project's time becomes the one that they span.

    Its step is the shortest of their times, in days. A layer without a time of its own changes nothing.
    """
    ranges: list[QgsDateTimeRange] = []

    def span(layer: Any, project: QgsProject) -> None:
        own = layer.temporalProperties().fixedTemporalRange()
        if own.isInfinite() or not own.begin().isValid():
            return
        ranges.append(own)
        settings = project.timeSettings()
        settings.setTemporalRange(QgsDateTimeRange(min(r.begin() for r in ranges), max(r.end() for r in ranges)))
        settings.setTimeStepUnit(QgsUnitTypes.TemporalUnit.TemporalDays)
        settings.setTimeStep(float(max(1, min(r.begin().daysTo(r.end()) for r in ranges))))

    return span
