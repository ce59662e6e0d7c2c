"""``report.pdf``: the report to sign, made of an output folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from ...core.progress import Progress
from ...core.staged_outputs import atomic_output
from ..figures_in_text import say
from .blocks import Document
from .content import report_document
from .details import Details
from .page_words import page_words
from .source import given_lines, read_source
from .typesetting import check_pdf, typeset

PDF = "report.pdf"


def write_pdf(
    folder: Path,
    record: Mapping[str, Any],
    page: str,
    *,
    target: Path | None = None,
    lines: Path | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write ``report.pdf`` into an output folder; its path.

    It is made of the folder alone, in the language of the environment: the same folder gives the same bytes where the
    fonts are the same.

    Args:
        record: the run record of the folder.
        page: the HTML report of the same record, whose words it takes.
        target: another file to write.
        lines: table of the sections' lines, if another than that of the folder.
        progress: gets a line with what is left to fill in by hand.

    Raises:
        InputError: a file of the folder cannot be read, the details do not fit the surveys, or what makes a PDF is
            missing.
    """
    words = page_words(page)
    source = read_source(record, folder, words)
    document = report_document(source, given_lines(lines or folder / "profiles.gpkg"))
    title = ", ".join(part for part in (source.details["slope_name"], words.title) if part)
    path = target or folder / PDF
    save(document, path, source.details, title, record)
    say_missing(source.details.missing, progress)
    return path


def save(document: Document, path: Path, details: Details, title: str, record: Mapping[str, Any]) -> None:
    """Typeset a document with its running header and page numbers."""
    place = " · ".join(part for part in (details["report_route"], details["chainage_range"]) if part)
    running = " · ".join(part for part in (title, place) if part)
    run = f", {say('run')} {record['run_id']}" if record.get("run_id") else ""
    client = f"{details['client']} · " if details["client"] else ""
    head = {
        "title": title,
        "authors": [details["author"]] if details["author"] else [],
        "running": running,
        "foot": f"{client}{record['software']}{run}",
        "page": _page_words(),
    }
    with atomic_output(path, check_pdf) as partial:
        typeset(document, head, date.fromisoformat(str(record["started"])[:10]), partial)


def say_missing(missing: Sequence[str], progress: Progress | None, name: str = PDF) -> None:
    """One line with the labels of what is left blank in the file ``name``."""
    if progress is not None and missing:
        names = ", ".join(say(label) for label in missing)
        progress.info(f"Left blank in {name}, to be filled in by hand: {names}.")


def _page_words() -> list[str]:
    """What stands before, between and after the number of a page and that of all pages."""
    before, _, rest = say("Page {0} of {1}").partition("{0}")
    between, _, after = rest.partition("{1}")
    return [before, between, after]
