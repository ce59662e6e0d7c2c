"""The command ``report``."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import DetailParameters, ReportParameters, command_sets
from .options import PATH, PROFILES_ALONG, Session, command, path_option


@click.command()
@click.argument("folder", type=PATH)
@PROFILES_ALONG
@path_option(
    "--photos", "Folder of pictures named after zones, such as Z001.jpg, which are shown with them.", metavar="DIR"
)
@command(*command_sets.REPORT, profile=False)
def report(session: Session, folder: Path, profiles: Path | None, photos: Path | None) -> RunResult:
    """Write the report of FOLDER again, which inspect, change, demchange, displacement, series, m3c2 or batch wrote.

    With --profiles its profiles are replaced by those along the given lines and through the zones. With --photos
    pictures are copied into the folder and shown with the zones that they are named after. With --pdf the report is
    also written as a PDF to sign; what is said in it of slope, people and flights is kept in the folder. Of a folder
    that batch wrote it is the page of the corridor, and its PDF; profiles and photos belong to the folder of a slope.
    Of several runs of m3c2 in one folder give the record, NAME_run.json.
    """
    from ..workflows.report_corridor import report_of_folder

    return report_of_folder(
        folder,
        session.parameters(ReportParameters),
        details=session.parameters(DetailParameters),
        profiles=profiles,
        photos=photos,
        progress=session.report,
    )
