"""The output folder of a run, as far as the panel uses it: which files are there."""

from __future__ import annotations

from pathlib import Path

RECORD, REPORT = "run.json", "report.html"
ZONE_FILES = ("zones.gpkg", "series.gpkg", "screened_zones.gpkg")
"""Files with zones, the first of which is what a person looks at first; each has its zones in a layer of this name:"""
ZONE_LAYER = "zones"
UNSEEN_LAYER = "not_seen"
"""What was not compared, in the same file."""


def file_of(source: str) -> Path:
    """The file of a layer's source, such as ``/results/zones.gpkg|layername=zones``."""
    return Path(source.partition("|")[0])


def run_folder(source: str) -> Path | None:
    """The output folder that a layer's file lies in; None where there is no run."""
    folder = file_of(source).parent
    return folder if (folder / RECORD).is_file() else None


def report_of(folder: Path | None) -> Path | None:
    """The report of a run; None without one."""
    report = None if folder is None else folder / REPORT
    return report if report is not None and report.is_file() else None


def zone_files(folder: Path) -> list[Path]:
    """The files of a folder that hold zones."""
    return [folder / name for name in ZONE_FILES if (folder / name).is_file()]
