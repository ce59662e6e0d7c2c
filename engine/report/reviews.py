"""People's reviews of the zones of an output folder, for its report: as its tables have them when it is made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pyogrio

from ...interface.reviews import PHOTO, REMARKS, REVIEWED, REVIEWER, STATUS
from ..core.errors import InputError
from ..core.gdal_names import readable
from ..core.messages import shown
from ..core.part_folders import PREFIX
from ..vector.geopackage import READ_FAULTS
from ..vector.review_fields import UNREVIEWED, is_entered
from .record_shape import inside

if TYPE_CHECKING:
    from .embedding import Picture

_FIELDS = (STATUS, REVIEWER, REVIEWED, REMARKS, PHOTO)
_MAX_PHOTOS = 60
"""In a report, which then has some 6 MB more."""


@dataclass(frozen=True)
class Review:
    """Review of one zone; empty fields where nothing was entered.

    ``photo_fault`` says in one sentence why a photo that was entered is not shown.
    """

    zone_id: str
    status: str
    reviewer: str
    remarks: str
    date: str = ""
    photo: Picture | None = None
    photo_fault: str = ""


def zone_reviews(path: Path) -> dict[str, Review]:
    """By its id each zone of the layer ``zones`` of a GeoPackage of which a state, a reviewer, remarks or a photo were
    given.

    There are none where the file does not exist or is from before there were such fields.

    Raises:
        InputError: it cannot be read.
    """
    if not path.exists():
        return {}
    try:
        with readable(path) as plain:
            table = pyogrio.read_dataframe(plain, layer="zones", read_geometry=False)
        if "zone_id" not in table:
            raise ValueError("no field zone_id")
    except READ_FAULTS as error:
        raise InputError(f"{path} cannot be read; make the run again.") from error
    found: dict[str, Review] = {}
    photos = 0
    for row in table.to_dict("records"):
        said = {name: str(row[name]).strip() if is_entered(name, row.get(name)) else "" for name in _FIELDS}
        if any(said[name] for name in _FIELDS if name != REVIEWED):
            zone = str(row["zone_id"])
            photos += bool(said[PHOTO])
            picture, fault = _photo(path.parent, said[PHOTO], zone, photos) if said[PHOTO] else (None, "")
            found[zone] = Review(
                zone, said[STATUS] or UNREVIEWED, said[REVIEWER], said[REMARKS], said[REVIEWED], picture, fault
            )
    return found


def _photo(folder: Path, entered: str, zone: str, number: int) -> tuple[Picture | None, str]:
    """The photo that was entered for a zone, or one sentence on why it is not shown.

    A table is text from a file: only pictures in the folder of the results are read.
    """
    # a run at work writes its tables in a folder in that of the results, where the photos are
    homes = (folder, folder.parent) if folder.name.startswith(PREFIX) else (folder,)
    places = [inside(home, entered) for home in homes]
    if number > _MAX_PHOTOS:
        return None, f"The photo {shown(entered)} is left out, because the report has {_MAX_PHOTOS} already."
    if None in places:
        return None, f"The photo {shown(entered)} lies outside the folder of the results and is not shown."
    # matplotlib takes half a second to import; nothing else of the engine should wait for it
    from .embedding import photo

    try:
        path = next((place for place in places if place is not None and place.is_file()), None)
        if path is None:
            return None, f"The photo {shown(entered)} is no longer there."
        return photo(path, f"Photo of {zone}"), ""
    except (OSError, ValueError):
        return None, f"The photo {shown(entered)} cannot be read as a picture."
