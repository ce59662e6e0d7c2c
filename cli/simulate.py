"""``slopewatch simulate``: surveys with known truth."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import CreepParameters, OutputParameters, ScenesParameters, SurveyParameters
from .commands import _output_dir
from .options import Session, command


@click.group()
def simulate() -> None:
    """Simulated surveys with known truth, to try SlopeWatch and to test it."""


@simulate.command()
@_output_dir
@command(SurveyParameters, OutputParameters, profile=False)
def survey(session: Session, output_dir: Path) -> RunResult:
    """Two surveys of one cut slope with a known change and a known rigid offset, the truth beside them."""
    from ..workflows.simulate import survey_step

    overwrite = session.parameters(OutputParameters).overwrite
    return survey_step(session.parameters(SurveyParameters), output_dir, session.report, overwrite=overwrite)


@simulate.command()
@_output_dir
@command(CreepParameters, OutputParameters, profile=False)
def series(session: Session, output_dir: Path) -> RunResult:
    """Dated surveys of one cut slope whose zones creep at known velocities: something to try `series` on.

    The folder holds one cloud a survey, a manifest (surveys.csv), the slope's outline and the truth.
    """
    from ..workflows.simulate import series_step

    overwrite = session.parameters(OutputParameters).overwrite
    return series_step(session.parameters(CreepParameters), output_dir, session.report, overwrite=overwrite)


@simulate.command()
@_output_dir
@command(ScenesParameters, OutputParameters, profile=False)
def scenes(session: Session, output_dir: Path) -> RunResult:
    """Slopes of one epoch with bulges, hollows and what looks like them, the class of every point known."""
    from ..workflows.simulate_scenes import scenes_step

    overwrite = session.parameters(OutputParameters).overwrite
    return scenes_step(session.parameters(ScenesParameters), output_dir, session.report, overwrite=overwrite)
