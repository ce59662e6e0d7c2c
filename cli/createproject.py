"""The command ``createproject``."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import ProjectParameters, command_sets
from .options import PATH, Session, command, path_option


@click.command()
@click.argument("run", type=PATH)
@path_option("--output", "The project, .qgz; next to the results it can be moved with them.", required=True)
@command(*command_sets.CREATEPROJECT, profile=False)
def createproject(session: Session, run: Path, output: Path) -> RunResult:
    """A QGIS project of the results in the folder RUN: groups, styles, times of the surveys, a print layout.

    QGIS makes it: its qgis_process is found on PATH, or named in the environment variable SLOPEWATCH_QGIS.
    """
    from ..workflows.createproject import project_step

    return project_step(
        run,
        output,
        session.parameters(ProjectParameters),
        overwrite=session.overwrite,
        progress=session.report,
    )
