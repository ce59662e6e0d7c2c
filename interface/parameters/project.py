"""Parameters of QGIS projects."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter

PAPERS = ("A4", "A3")


@dataclass(frozen=True)
class ProjectParameters(ParameterSet, record_name="project", title="Project"):
    """What the print layout of a project says, and its size."""

    project_title: str = _parameter(
        "",
        "Title",
        "Title of the project and of its sheet. Empty: the folder's name and the days of the surveys.",
    )
    author: str = _parameter("", "Author", "Who made it, in the title block of the sheet. Empty: left out.")
    paper: str = _parameter(
        "A4", "Paper", "Size of the sheet, which lies on its side. A3 shows more of the map.", choices=PAPERS
    )
