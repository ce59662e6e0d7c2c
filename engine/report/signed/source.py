"""An output folder as the report to sign reads it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
from numpy.typing import NDArray

from ...vector.geopackage import read_layer
from ...zones.profile_lines import GIVEN, ProfileLine
from ..figures_in_text import say
from ..reviews import Review, zone_reviews
from .details import Details, details_of
from .maps import MapLayers
from .page_words import PageWords


@dataclass(frozen=True)
class Source:
    """An output ``folder`` as read: its ``record``, the ``words`` of its page, tables and reviews of its ``zones`` and
    of the ``screened`` ones, the names of its ``surveys``, and of a series the ``events`` by zone and survey.
    """

    folder: Path
    record: Mapping[str, Any]
    words: PageWords
    details: Details
    zones: gpd.GeoDataFrame
    screened: gpd.GeoDataFrame
    reviews: Mapping[str, Review]
    screened_reviews: Mapping[str, Review]
    surveys: tuple[str, ...]
    events: Mapping[tuple[str, str], str] = field(default_factory=dict)

    @property
    def is_series(self) -> bool:
        return bool(self.record["command"] == "series")

    @property
    def is_screening(self) -> bool:
        """Of one survey."""
        return not (self.is_series or self.is_motion or self.is_face or self.record.get("epochs"))

    @property
    def is_face(self) -> bool:
        """Of distances along the normals of a face."""
        return bool(self.record["command"] == "m3c2")

    @property
    def is_motion(self) -> bool:
        """Of motion along the surface alone."""
        return bool(self.record["command"] == "displacement")

    @property
    def ends(self) -> tuple[str, str]:
        """Names of the first and of the last survey."""
        return (self.surveys[0], self.surveys[-1]) if self.surveys else ("", "")


def read_source(record: Mapping[str, Any], folder: Path, words: PageWords) -> Source:
    """The tables of an output folder.

    Raises:
        InputError: one of them cannot be read, or the details do not fit the surveys.
    """
    name = zones_file(record)
    zones, screened = _table(folder / name), _table(folder / "screened_zones.gpkg")
    surveys = surveys_of(record)
    return Source(
        folder=folder,
        record=record,
        words=words,
        details=details_of(record, surveys, (zones, screened)),
        zones=zones,
        screened=screened,
        reviews=zone_reviews(folder / name),
        screened_reviews=zone_reviews(folder / "screened_zones.gpkg"),
        surveys=surveys,
        events=_events(folder / name) if record["command"] == "series" else {},
    )


def zones_file(record: Mapping[str, Any]) -> str:
    """Name of the file of zones that a run of its command writes."""
    return {"series": "series.gpkg", "m3c2": "m3c2_zones.gpkg"}.get(record["command"], "zones.gpkg")


def surveys_of(record: Mapping[str, Any]) -> tuple[str, ...]:
    """The names of the surveys of a run record, the earliest first."""
    surveys = [str(epoch["name"]) for epoch in record.get("epochs") or []]
    roles = [str(i["role"]) for i in record["inputs"]]
    return tuple(surveys or [role.removeprefix("epoch ") for role in roles if role.startswith("epoch ")])


def map_layers(source: Source) -> MapLayers:
    """What the maps show of a folder: zones, screened zones, footprints of the volumes, and vectors of motion."""
    zones = source.folder / zones_file(source.record)
    footprints = read_layer(zones, "footprints") if not source.is_series and zones.is_file() else None
    return MapLayers(
        source.zones,
        source.screened if len(source.screened) else None,
        footprints,
        vectors=vectors_of_motion(source.folder / "displacement.gpkg"),
    )


def given_lines(path: Path) -> Sequence[ProfileLine]:
    """The lines of sections that people gave, as a run keeps them; none without the file."""
    if not path.is_file():
        return ()
    frame = read_layer(path, "profiles")
    named = zip(frame["name"], frame["kind"], frame.geometry, strict=True)
    return [ProfileLine(str(name), line, GIVEN) for name, kind, line in named if kind == GIVEN]


def vectors_of_motion(path: Path) -> NDArray[np.float64]:
    """Place and motion on the map (n, 4) of the significant vectors where ground moves as one, until the last survey.

    Single vectors elsewhere may be made by chance, and are left to the map of motion.
    """
    if not path.is_file():
        return np.zeros((0, 4))
    frame, moving = read_layer(path, "vectors"), read_layer(path, "zones")
    if "time_to" in frame:
        frame = frame[frame["time_to"] == frame["time_to"].max()]
    frame = frame[frame.intersects(moving.union_all())] if len(moving) else frame[:0]
    columns = frame.geometry.x, frame.geometry.y, frame["east_m"], frame["north_m"]
    return np.column_stack([np.asarray(column, dtype=np.float64) for column in columns]).reshape(-1, 4)


def _events(path: Path) -> dict[tuple[str, str], str]:
    """State and event of each zone at each survey, such as ``lowered, continued``."""
    if not path.is_file():
        return {}
    frame = read_layer(path, "series")
    if not {"zone_id", "epoch", "state", "event"} <= set(frame.columns):
        return {}
    found = {}
    for zone, epoch, *words in zip(*(frame[name] for name in ("zone_id", "epoch", "state", "event")), strict=True):
        found[str(zone), str(epoch)] = ", ".join(dict.fromkeys(say(w) for w in words if isinstance(w, str) and w))
    return found


def _table(path: Path) -> gpd.GeoDataFrame:
    if not path.is_file():
        return gpd.GeoDataFrame({"zone_id": []}, geometry=[])
    return read_layer(path, "zones")
