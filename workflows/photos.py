"""Photos of zones, from a folder of pictures that are named after them, into the tables of an output folder."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

from ..engine.core.cancellation import uninterrupted
from ..engine.core.errors import InputError
from ..engine.core.input_files import read_input
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.report.embedding import photo
from ..interface.input_files import PHOTO as PICTURE_FILE
from ..interface.reviews import PHOTO

FOLDER = "photos"
TABLES = ("zones.gpkg", "series.gpkg", "screened_zones.gpkg", "m3c2_zones.gpkg")
_LAYER = "zones"
_PICTURES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp"})
_NAMED = 5  # in a message
_WAIT_S = 5.0
_SPATIAL = ("ST_IsEmpty", "ST_MinX", "ST_MaxX", "ST_MinY", "ST_MaxY")
"""Functions that triggers of a GeoPackage's spatial index name; none of them runs where no shape changes."""


def enter_photos(folder: Path, pictures: Path, progress: Progress) -> int:
    """Copy pictures to ``photos/`` of an output folder and enter them for their zones; how many zones have got one.

    A picture belongs to the zone whose id its name begins with: ``Z001.jpg``, ``z001 crack.png``. Of several the first
    by name is taken. One that was entered before is replaced.

    Raises:
        InputError: there is no such folder, table or picture of a zone, one cannot be read, or a table is in use.
    """
    tables = {path: _ids(path) for name in TABLES if (path := folder / name).is_file()}
    if not tables:
        raise InputError(f"{shown(folder)} has no table of zones that photos could belong to.")
    chosen = _chosen(pictures, [zone for ids in tables.values() for zone in ids], progress)
    for path in chosen.values():
        try:
            photo(path, "")
        except (OSError, ValueError) as error:
            raise InputError(f"The photo {shown(path)} cannot be read as a picture; save it as JPEG or PNG.") from error
    with uninterrupted():
        entered = {zone: _copied(path, folder / FOLDER, zone) for zone, path in chosen.items()}
        for path, ids in tables.items():
            _enter(path, {zone: entered[zone] for zone in ids if zone in entered})
    return len(chosen)


def _chosen(pictures: Path, zones: list[str], progress: Progress) -> dict[str, Path]:
    """The picture of each zone that has one."""
    if not pictures.is_dir():
        raise InputError(f"The folder of photos {shown(pictures)} does not exist; check the path.")
    files = sorted(p for p in pictures.iterdir() if p.is_file() and p.suffix.lower() in _PICTURES)
    if not files:
        raise InputError(f"{shown(pictures)} holds no picture; give a folder of JPEG, PNG, TIFF or WebP files.")
    found: dict[str, list[Path]] = {}
    strange: list[str] = []
    known = {zone.lower(): zone for zone in zones}
    for file in files:
        begin = re.match(r"[^\W_]+", file.stem)
        zone = known.get(begin.group().lower()) if begin else None
        if zone is None:
            strange.append(file.name)
        else:
            found.setdefault(zone, []).append(file)
    if not found:
        raise InputError(
            f"No picture in {shown(pictures)} is named after a zone; begin their names with one of "
            f"{', '.join(zones[:_NAMED])}, such as {zones[0] if zones else 'Z001'}.jpg."
        )
    if strange:
        progress.warning(
            f"{len(strange)} pictures are named after no zone and are left out: {', '.join(strange[:_NAMED])}."
        )
    for zone, several in found.items():
        if len(several) > 1:
            progress.warning(f"{zone} has {len(several)} pictures; {several[0].name} is shown.")
    return {zone: several[0] for zone, several in found.items()}


def _ids(path: Path) -> list[str]:
    """The ids in a table of zones."""
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
            return [str(row[0]) for row in database.execute(f'SELECT zone_id FROM "{_LAYER}"')]
    except sqlite3.Error as error:
        raise InputError(f"{shown(path)} cannot be read; make the run again.") from error


def _copied(picture: Path, folder: Path, zone: str) -> str:
    """Path of the copy from the output folder; another file of that name is kept."""
    folder.mkdir(exist_ok=True)
    content = read_input(picture, PICTURE_FILE)
    number = 1
    while True:
        target = folder / f"{zone}{'' if number == 1 else f'_{number}'}{picture.suffix.lower()}"
        if not target.exists():
            target.write_bytes(content)
            break
        if target.is_file() and target.read_bytes() == content:
            break
        number += 1
    return f"{FOLDER}/{target.name}"


def _enter(path: Path, photos: Mapping[str, str]) -> None:
    """Enter the paths into the column for them, which is added with the first.

    Raises:
        InputError: another program writes into the table, or it is read-only.
    """
    if not photos:
        return
    try:
        with closing(sqlite3.connect(path, timeout=_WAIT_S)) as database, database:
            for name in _SPATIAL:
                database.create_function(name, 1, lambda _: None)
            columns = {str(row[1]).lower() for row in database.execute(f'PRAGMA table_info("{_LAYER}")')}
            if PHOTO not in columns:
                database.execute(f'ALTER TABLE "{_LAYER}" ADD COLUMN "{PHOTO}" TEXT')
            for zone, entered in photos.items():
                database.execute(f'UPDATE "{_LAYER}" SET "{PHOTO}" = ? WHERE zone_id = ?', (entered, zone))
    except sqlite3.Error as error:
        raise InputError(
            f"The photos cannot be entered in {shown(path)} ({error}); end editing it in other programs and try again."
        ) from error
