"""``slopewatch simulate``: surveys with known truth."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import CreepParameters, ScenesParameters, SurveyParameters, command_sets
from .options import OUTPUT_DIR, Session, command


@click.group()
def simulate() -> None:
    """Simulated surveys with known truth, to try SlopeWatch and to test it."""


@simulate.command()
@OUTPUT_DIR
@command(*command_sets.SIMULATE_SURVEY, profile=False)
def survey(session: Session, output_dir: Path) -> RunResult:
    """Two surveys of one cut slope with a known change and a known rigid offset, with the truth."""
    from ..workflows.simulate import survey_step

    return survey_step(session.parameters(SurveyParameters), output_dir, session.report, overwrite=session.overwrite)


@simulate.command()
@OUTPUT_DIR
@command(*command_sets.SIMULATE_SERIES, profile=False)
def series(session: Session, output_dir: Path) -> RunResult:
    """Dated surveys of one cut slope whose zones creep at known velocities: input to try `series` with.

    The folder holds one cloud per survey, a manifest (surveys.csv), the slope's outline and the truth.
    """
    from ..workflows.simulate import series_step

    return series_step(session.parameters(CreepParameters), output_dir, session.report, overwrite=session.overwrite)


@simulate.command()
@OUTPUT_DIR
@command(*command_sets.SIMULATE_SCENES, profile=False)
def scenes(session: Session, output_dir: Path) -> RunResult:
    """Slopes of one epoch with bulges, hollows and look-alikes, where the class of every point is known."""
    from ..workflows.simulate_scenes import scenes_step

    return scenes_step(session.parameters(ScenesParameters), output_dir, session.report, overwrite=session.overwrite)
