"""The report's section on motion along the surface, made of the files of an output folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np

from ..core.arrays import Bool
from ..displacement.status import Status
from ..grid.geotiff import read_raster
from ..grid.grid import Grid
from ..grid.listed_raster import ListedRasters, read_listed
from ..maps.displacement_styles import magnification
from ..maps.motion_map import Arrows, MotionMap, motion_figure
from ..vector.geopackage import read_layer
from ..zones.profile_lines import ProfileLine, steepest_lines
from ..zones.profiles import Layers, Profile, take_profile
from ..zones.section_vectors import SectionVectors, vectors_near
from .embedding import Picture, map_picture
from .maps import ground_picture
from .motion_charts import section_chart

_STATUS_BAND = 16
_MAX_ARROWS_A_SIDE = 60  # on a map; of more, the surest of each square are drawn
_MAX_SECTIONS = 4
_PALER = 0.45  # of the ground under the arrows


@dataclass(frozen=True)
class MotionFiles:
    """Where the parts of the section lie: rasters and layers of the motion, and the heights of both surfaces, if any.

    Attributes:
        displacement, layers: as ``displacement.tif`` and ``displacement.gpkg``.
        heights: as ``surface_heights.tif``.
    """

    displacement: Path
    layers: Path
    heights: Path

    @classmethod
    def of(cls, folder: Path) -> MotionFiles:
        """Under the names that they have in every output folder."""
        return cls(folder / "displacement.tif", folder / "displacement.gpkg", folder / "surface_heights.tif")


@dataclass(frozen=True)
class MotionSection:
    """What the template shows.

    Attributes:
        place: where its figures stand in the record; ``facts`` are they.
        magnification: how many times as long as in truth the map's arrows are.
        sections: through the largest zones, name of the zone and picture.
        most_zones: in the table.
    """

    place: tuple[str | int, ...]
    facts: Mapping[str, Any]
    map: Picture
    magnification: float
    sections: tuple[tuple[str, Picture], ...]
    most_zones: int = 40


def motion_section(
    facts: Mapping[str, Any] | None,
    files: MotionFiles,
    epochs: tuple[str, str],
    place: tuple[str | int, ...] = ("displacement",),
) -> MotionSection | None:
    """The section; None where nothing was measured, so that the record has no ``facts`` of it.

    Args:
        facts: of ``motion_facts``.
        epochs: names of both surveys.
        place: of these facts in the record.

    Raises:
        InputError: a file is missing or damaged.
    """
    if not facts:
        return None
    vectors, zones = (read_layer(files.layers, name) for name in ("vectors", "zones"))
    status = read_raster(files.displacement, _STATUS_BAND)
    times = magnification(vectors[["east_m", "north_m"]].to_numpy(dtype=np.float64), status.grid.cell)
    every = max(1, -(-max(status.grid.shape) // _MAX_ARROWS_A_SIDE))
    drawn = surest(vectors, every * status.grid.cell)
    known = status.array == Status.MEASURED
    unseen = np.isfinite(status.array) & ~known
    ground = None
    if files.heights.is_file():
        ground = ground_picture(files.heights, paler=_PALER)
        # ground without a window is not known either, and must not look as if it were
        unseen |= cells_with_ground(files.heights, status.grid) & ~known
    shown = MotionMap(
        grid=status.grid,
        known=known,
        unseen=unseen,
        backdrop=ground,
        vectors=Arrows.of(drawn),
        zones=zones,
        magnification=every * times,
    )
    text = (
        "Map of motion along the surface: arrows of the vectors beyond chance with the ellipses of their errors, the "
        "zones that move as one outlined, and grey where nothing is known of motion"
    )
    sections = _sections(files, vectors, zones, epochs) if files.heights.is_file() and len(zones) else ()
    return MotionSection(place, facts, map_picture(motion_figure(shown, epochs), text), shown.magnification, sections)


def cells_with_ground(heights: Path, grid: Grid) -> Bool:
    """Which cells of a grid hold ground that the later survey measured."""
    raster = read_listed([(heights, 2)])
    row, column = raster.layout.row_and_column(np.flatnonzero(np.isfinite(raster.values[0])))
    east = raster.grid.west + (column + 0.5) * raster.grid.cell - grid.west
    south = grid.north - (raster.grid.north - (row + 0.5) * raster.grid.cell)
    place = np.floor(np.stack([south, east]) / grid.cell).astype(np.int64)
    inside = ((place >= 0) & (place < np.array(grid.shape)[:, None])).all(axis=0)
    found = np.zeros(grid.shape, dtype=bool)
    found[tuple(place[:, inside])] = True
    return found


def surest(vectors: gpd.GeoDataFrame, side: float) -> gpd.GeoDataFrame:
    """Of the vectors in each square of ``side`` metres the one that is surest to be no chance."""
    if not len(vectors):
        return vectors
    square = np.floor(np.column_stack([vectors.geometry.x, vectors.geometry.y]) / side).astype(np.int64)
    order = np.argsort(vectors["p_value"].to_numpy(), kind="stable")
    first = np.unique(square[order], axis=0, return_index=True)[1]
    return vectors.iloc[np.sort(order[first])]


def near_lines(layers: Path, lines: Path) -> dict[str, SectionVectors]:
    """The vectors near each line of ``profiles.gpkg``, by its name; none without either file."""
    if not (layers.is_file() and lines.is_file()):
        return {}
    vectors = read_layer(layers, "vectors")
    frame = read_layer(lines, "profiles")
    return {str(name): vectors_near(line, vectors) for name, line in zip(frame["name"], frame.geometry, strict=True)}


def _sections(
    files: MotionFiles, vectors: gpd.GeoDataFrame, zones: gpd.GeoDataFrame, epochs: tuple[str, str]
) -> tuple[tuple[str, Picture], ...]:
    """Down the largest zones: both surfaces with the vectors near the line."""
    heights = read_listed([(files.heights, 1), (files.heights, 2)])
    later = heights.values[1]
    lines = steepest_lines(zones, later, np.ones_like(later), heights.grid, _MAX_SECTIONS, heights.layout)
    drawn = []
    for line in lines:
        profile = _profile(line, heights)
        if len(profile.distance) < 2:
            continue
        zone = zones.geometry[zones["zone_id"] == line.zone_id].iloc[0]
        near = vectors_near(line.geometry, vectors)
        drawn.append((line.zone_id, section_chart(profile, near, line.geometry.intersection(zone), epochs)))
    return tuple(drawn)


def _profile(line: ProfileLine, heights: ListedRasters) -> Profile:
    earlier, later = heights.values
    change = later - earlier
    nothing = np.zeros_like(change)
    return take_profile(
        line, Layers(heights.grid, earlier, later, change, nothing, nothing.astype(bool), heights.layout)
    )
