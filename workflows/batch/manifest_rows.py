"""The rows of a manifest as texts by column, whatever it is: CSV, a layer of polygons, or a folder of folders."""

from __future__ import annotations

from pathlib import Path

from ...engine.core.errors import InputError
from ...engine.core.messages import shown
from ...engine.epochs.manifest import CLOUD_ENDINGS, read_table
from ...interface.dates import date_in_name
from .manifest_table import Row, Table

NEEDED = ("slope", "date", "file")
_ROI_ENDINGS = (".gpkg", ".geojson", ".shp", ".kml")
_VECTORS = (".gpkg", ".geojson", ".json", ".shp", ".fgb")


def rows_of(source: Path) -> Table:
    """The rows of a manifest.

    Raises:
        InputError: it does not exist, cannot be read, holds no row, or lacks a column.
    """
    name = shown(source)
    if source.is_dir() and source.suffix.lower() != ".gdb":
        table = _folder_rows(source)
    elif not source.exists():
        raise InputError(f"The manifest {name} does not exist; give a CSV file, a GeoPackage or a folder.")
    elif source.suffix.lower() in CLOUD_ENDINGS:
        raise InputError(f"{name} is a cloud; give a manifest of the slopes (CSV, GeoPackage or a folder of folders).")
    elif source.suffix.lower() in _VECTORS:
        from .manifest_layer import layer_rows  # its libraries take longer to load than a finished corridor to look at

        table = layer_rows(source)
    else:
        table = _csv_rows(source)
    missing = [column for column in NEEDED if column not in table.columns]
    if missing:
        raise InputError(f"The manifest {name} has no column {missing[0]}; it needs {', '.join(NEEDED)} and roi.")
    if not table.rows:
        raise InputError(f"The manifest {name} holds no survey; give one row for each.")
    return table


def _csv_rows(source: Path) -> Table:
    lines = read_table(source, "manifest")
    if not lines:
        raise InputError(f"The manifest {shown(source)} is empty; give a line slope,date,file,roi and one a survey.")
    head = tuple(cell.strip().lower() for cell in lines[0][1])
    twice = sorted({column for column in head if column and head.count(column) > 1})
    if twice:
        raise InputError(f"The manifest {shown(source)} has the column {twice[0]} twice; remove one.")
    rows = []
    for number, cells in lines[1:]:
        values = dict(zip(head, (cell.strip() for cell in cells), strict=False))
        more = [cell for cell in cells[len(head) :] if cell.strip()]
        problem = f"it has {len(cells)} values for {len(head)} columns; quote texts with commas." if more else ""
        rows.append(Row(f"Line {number}", values, problem=problem))
    return Table(tuple(column for column in head if column), tuple(rows), source.parent)


def _folder_rows(source: Path) -> Table:
    """One slope a folder, with dated clouds; a single vector file named roi is its region."""
    rows = []
    folders = sorted(p for p in source.iterdir() if p.is_dir() and not p.name.startswith("."))
    if not folders:
        raise InputError(f"The folder {shown(source)} holds no folder; give each slope one, with its dated clouds.")
    for folder in folders:
        name = folder.name.encode("utf-8", "backslashreplace").decode()
        clouds = sorted(p for p in folder.iterdir() if p.is_file() and p.suffix.lower() in CLOUD_ENDINGS)
        place = f"Folder {shown(name)}"
        if not clouds:
            rows.append(Row(place, {"slope": name}, problem="it holds no LAS or LAZ file; give its surveys."))
        region = next((f.absolute() for end in _ROI_ENDINGS for f in [folder / f"roi{end}"] if f.is_file()), "")
        for cloud in clouds:
            day = date_in_name(cloud)
            values = {"slope": name, "date": day.isoformat() if day else "", "roi": str(region)}
            problem = "" if day else f"the name of {shown(cloud.name)} does not hold exactly one date; rename it."
            rows.append(Row(place, values, path=cloud.absolute(), problem=problem))
    return Table((*NEEDED, "roi"), tuple(rows), source)
