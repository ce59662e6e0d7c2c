"""Parameters of series of surveys."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter


@dataclass(frozen=True)
class SeriesParameters(ParameterSet, record_name="series"):
    """More than two surveys of one slope."""

    ground_ready: bool = _parameter(
        False,
        "Clouds are ground already",
        "The older name of as_is under Ground points: takes all points of the clouds inside the region of interest.",
        advanced=True,
    )
    rasters_each_survey: bool = _parameter(
        True,
        "Rasters of every survey",
        "Also writes the change and its level of detection for each survey against the first and against the one "
        "before. Off: velocity, confirmation and zones only.",
    )
