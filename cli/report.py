"""The command ``report``."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import DetailParameters, ReportParameters, command_sets
from .options import PATH, PROFILES_ALONG, Session, command


@click.command()
@click.argument("folder", type=PATH)
@PROFILES_ALONG
@command(*command_sets.REPORT, profile=False)
def report(session: Session, folder: Path, profiles: Path | None) -> RunResult:
    """Write the report of FOLDER again, which inspect, change or series wrote.

    With --profiles its profiles are replaced by those along the given lines and through the zones. With --pdf it is
    also written as a PDF to sign; what is said in it of slope, people and flights is kept in the folder.
    """
    from ..workflows.report import report_step

    return report_step(
        folder,
        session.parameters(ReportParameters),
        details=session.parameters(DetailParameters),
        profiles=profiles,
        progress=session.report,
    )
