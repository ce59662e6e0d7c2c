"""Surveys with known truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..interface.parameters import CreepParameters, SurveyParameters, command_sets
from ..workflows.given_values import Values
from ..workflows.simulate import series_step, survey_step
from .given import PathLike


def simulate(
    output_dir: PathLike, *, series: bool = False, progress: Progress | None = None, **parameters: Any
) -> RunResult:
    """Surveys with known truth, as ``slopewatch simulate survey``, or a ``series`` of them."""
    values = Values(parameters, command_sets.SIMULATE_SERIES if series else command_sets.SIMULATE_SURVEY)
    folder, report = Path(output_dir), progress or Progress()
    if series:
        return series_step(values.of(CreepParameters), folder, report, overwrite=values.overwrite)
    return survey_step(values.of(SurveyParameters), folder, report, overwrite=values.overwrite)
