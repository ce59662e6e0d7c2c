"""The command ``report``."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import ReportParameters
from .options import Session, command

_FILE = click.Path(path_type=Path)
PROFILES_OPTION = click.option(
    "--profiles", type=_FILE, default=None, metavar="FILE", help="Vector file whose lines profiles are taken along."
)


@click.command()
@click.argument("folder", type=_FILE)
@PROFILES_OPTION
@command(ReportParameters, profile=False)
def report(session: Session, folder: Path, profiles: Path | None) -> RunResult:
    """Make the report of FOLDER, which inspect, change or series wrote, again.

    With --profiles its profiles are replaced by those along the lines given, beside those through the zones. The other
    options have no effect without it.
    """
    from ..workflows.report import report_step

    return report_step(folder, session.parameters(ReportParameters), profiles=profiles, progress=session.report)
