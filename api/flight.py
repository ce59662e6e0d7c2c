"""Planning the next survey."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..interface.parameters import FlightParameters, InputParameters, MissionParameters, command_sets
from ..workflows.compareflight import compareflight_step
from ..workflows.given_values import Values
from ..workflows.planflight import planflight_step
from .given import PathLike, paths


def plan_flight(
    terrain: PathLike,
    roi: PathLike,
    output_dir: PathLike,
    *,
    survey: PathLike | None = None,
    plan: PathLike | None = None,
    season: Iterable[PathLike] = (),
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """Flight lines over a region and what they will show, as ``slopewatch planflight``.

    ``terrain`` is an elevation model or the last survey's ground, ``survey`` that survey with its plants, ``plan`` an
    earlier plan whose lines are flown again, ``season`` classified surveys of several dates (clouds whose names hold
    their date, texts such as ``2025-07-01=cloud.laz``, or a folder) that show in which month most ground is seen.
    """
    values = Values(parameters, command_sets.PLANFLIGHT)
    return planflight_step(
        Path(terrain),
        Path(roi),
        Path(output_dir),
        values.of(FlightParameters),
        values.of(InputParameters),
        mission=values.of(MissionParameters),
        season=[str(survey) for survey in season],
        **paths(survey=survey, plan=plan),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )


def compare_flight(
    plan: PathLike,
    cloud: PathLike,
    output_dir: PathLike,
    *,
    ground: PathLike | None = None,
    trajectory: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """A survey as flown and the plan (``plan.gpkg``) by which it was flown, as ``slopewatch compareflight``.

    ``ground`` is the survey's ground, without it the cloud's class 2; ``trajectory`` a CSV with time, x, y and z.
    """
    values = Values(parameters, command_sets.COMPAREFLIGHT)
    return compareflight_step(
        Path(plan),
        Path(cloud),
        Path(output_dir),
        values.of(InputParameters),
        **paths(ground=ground, trajectory=trajectory),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )
