"""People's reviews of the zones of an output folder, for its report: as its tables have them when it is made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pyogrio

from ..core.errors import InputError
from ..core.gdal_names import readable
from ..vector.review_fields import UNREVIEWED, is_entered

_FIELDS = ("review_status", "reviewer", "remarks")


@dataclass(frozen=True)
class Review:
    """Review of one zone; empty fields where nothing was entered."""

    zone_id: str
    status: str
    reviewer: str
    remarks: str


def zone_reviews(path: Path) -> dict[str, Review]:
    """By its id each zone of the layer ``zones`` of a GeoPackage of which a state, a reviewer or remarks were given.

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
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"{path} cannot be read; make the run again.") from error
    found = {}
    for row in table.to_dict("records"):
        said = {name: str(row[name]).strip() if is_entered(name, row.get(name)) else "" for name in _FIELDS}
        if any(said.values()):
            zone = str(row["zone_id"])
            found[zone] = Review(zone, said["review_status"] or UNREVIEWED, said["reviewer"], said["remarks"])
    return found
