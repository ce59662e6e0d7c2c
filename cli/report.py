"""The command ``report``."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import ReportParameters, command_sets
from .options import PATH, PROFILES_ALONG, Session, command


@click.command()
@click.argument("folder", type=PATH)
@PROFILES_ALONG
@command(*command_sets.REPORT, profile=False)
def report(session: Session, folder: Path, profiles: Path | None) -> RunResult:
    """Write the report of FOLDER again, which inspect, change or series wrote.

    With --profiles its profiles are replaced by those along the given lines and through the zones. The other options
    have no effect without it.
    """
    from ..workflows.report import report_step

    return report_step(folder, session.parameters(ReportParameters), profiles=profiles, progress=session.report)
