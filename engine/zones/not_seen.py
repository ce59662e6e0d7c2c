"""What two surveys did not compare of a slope, as polygons for maps: one a reason."""

from __future__ import annotations

import geopandas as gpd
import numpy as np
from pyproj import CRS

from ...interface.seen import KEYS, NOT_SEEN
from ..change.coverage import Seen
from ..crs.working_frame import horizontal
from ..grid.grid import Grid
from ..vector.cell_polygons import cell_polygons, table_column
from .fields import NOT_SEEN_FIELDS


def not_seen_frame(of_slope: Seen, grid: Grid, crs: CRS | None) -> gpd.GeoDataFrame:
    """A MultiPolygon along the cells' edges for each reason that occurs, with its area; columns ``NOT_SEEN_FIELDS``."""
    present = [one for one in NOT_SEEN if of_slope.area(one)]
    number = np.zeros(max(KEYS) + 1, dtype=np.int32)
    number[present] = np.arange(1, len(present) + 1)
    values = {
        "reason": np.array([KEYS[one] for one in present], dtype=object),
        "area_m2": np.array([of_slope.area(one) for one in present]),
    }
    return gpd.GeoDataFrame(
        {name: table_column(values[name], kind, len(present)) for name, kind in NOT_SEEN_FIELDS.items()},
        geometry=cell_polygons(number[of_slope.classes], len(present), grid),
        crs=horizontal(crs),
    )
