"""Places on roads as columns of a table of zones."""

from __future__ import annotations

from dataclasses import dataclass

import geopandas as gpd
import numpy as np

from ..vector.cell_polygons import table_column
from ..vector.review_fields import LOCATION, LOCATION_FIELDS, ON_ROAD, PLACE_FIELDS, is_entered
from .network import Network, Place

PLACED: dict[str, str] = {name: PLACE_FIELDS[name] for name in ON_ROAD} | LOCATION_FIELDS
"""Name and kind of the columns that are filled in."""
_MOST_NAMED = 3


@dataclass(frozen=True)
class Located:
    """A table with ``PLACED``.

    ``placed`` rows got a place, ``kept`` have the one that people entered, ``unplaced`` are the others' numbers (from
    0) and why.
    """

    frame: gpd.GeoDataFrame
    placed: int
    kept: int
    unplaced: tuple[tuple[int, str], ...]

    def warnings(self, what: str = "zones", name: str = "zone_id") -> list[str]:
        """Sentences on what has no place; ``name`` is the column that names a row."""
        if not self.unplaced:
            return []
        named = [
            f"{self.frame[name].iloc[i] if name in self.frame else i + 1}: {why}"
            for i, why in self.unplaced[:_MOST_NAMED]
        ]
        rest = len(self.unplaced) - len(named)
        more = f" And {rest} more, see the field location_note." if rest else ""
        return [f"{len(self.unplaced)} of {len(self.frame)} {what} have no place on the road. {' '.join(named)}{more}"]


def located(frame: gpd.GeoDataFrame, network: Network) -> Located:
    """``frame`` (in the network's reference system) with the place of each row.

    Rows in which people entered a place keep it: they have one, but no ``location``.
    """
    rows: list[dict[str, object]] = []
    unplaced: list[tuple[int, str]] = []
    kept = 0
    for number, shape in enumerate(frame.geometry):
        before = {name: frame[name].iloc[number] for name in (*ON_ROAD, LOCATION) if name in frame}
        if not is_entered(LOCATION, before.get(LOCATION)) and any(is_entered(n, before.get(n)) for n in ON_ROAD):
            rows.append({name: before.get(name) for name in ON_ROAD})
            kept += 1
            continue
        place = network.place_of(shape)
        if isinstance(place, str):
            unplaced.append((number, place))
            rows.append({"location_note": place})
        else:
            rows.append(_row(place))
    columns = {}
    for name, kind in PLACED.items():
        values = [row.get(name) for row in rows]
        filled = (
            ["" if v is None else v for v in values] if kind == "text" else [np.nan if v is None else v for v in values]
        )
        column = table_column(np.array(filled, dtype=object if kind == "text" else np.float64), kind, len(rows))
        columns[name] = column.set_axis(frame.index)
    return Located(frame.assign(**columns), len(rows) - kept - len(unplaced), kept, tuple(unplaced))


def _row(place: Place) -> dict[str, object]:
    return {
        "route": place.route,
        "chain_from": place.chain_from,
        "chain_to": place.chain_to,
        "side": place.side,
        "carriageway": place.carriageway,
        "offset_m": place.offset,
        "offset_mid_m": place.offset_mid,
        LOCATION: place.text,
    }
