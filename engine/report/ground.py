"""The report's section on the ground: which surveys it covers, maps of their ground returns, a chart of heights.

The figures come from the run record, the maps from the classified clouds that the run kept. A run of an older version
has no such figures, one of clouds that were ground already has neither.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from laspy import DecompressionSelection

from ..core.arrays import Float, Index
from ..grid.grid import Grid
from ..ground.cover import CLASSES
from ..ground.cover_squares import FINEST_SQUARE_M, CoverCells, cover_cells
from ..ground.pdal_pipelines import GROUND
from ..maps.map_parts import INK, SMALL, Sheet
from ..maps.palette import SEQUENTIAL, Colour, colours_at
from ..maps.picture_words import fonts, say
from ..pointcloud.header import preflight
from ..pointcloud.records import read_records
from .charts import finish
from .embedding import Picture, drawing
from .maps import panel
from .record_shape import inside

NO_GROUND: Colour = (0xA0, 0x3A, 0x8C)
_MAX_PIXELS = 1200
_GREY, _DARK = "#c9ccd1", "#62826c"
_PANEL_INCHES = 3.6  # inches of a panel of the chart


def ground_section(record: Mapping[str, Any], folder: Path) -> dict[str, Any] | None:
    """What the template of the section takes; None where the run extracted no ground.

    ``surveys`` are all with figures, each with its name and ``place`` in the record; ``shown`` the first and the last
    survey, which have a table, a map and their part of the chart.
    """
    surveys = [
        {"name": name, "place": ("stages", number, "epochs", name), **_of_survey(facts, folder)}
        for number, stage in enumerate(record.get("stages") or [])
        if isinstance(stage.get("epochs"), dict)
        for name, facts in stage["epochs"].items()
    ]
    surveys = [s for s in surveys if s["cover"] or s["cloud"] or s["strips"]]
    if not surveys:
        return None
    shown = surveys[:1] + surveys[1:][-1:]
    maps = iter(ground_maps([s["cloud"] for s in shown if s["cloud"]], [s["name"] for s in shown if s["cloud"]]))
    return {
        "surveys": [s for s in surveys if s["cover"]],
        "fitted": [s for s in surveys if s["strips"]],
        "shown": [s | {"map": next(maps) if s["cloud"] else None} for s in shown],
        "heights": heights_chart([(s["name"], s["cover"]["heights"]) for s in shown if s["cover"]]),
        "labels": CLASSES,
        "given": _given(record),
    }


def _given(record: Mapping[str, Any]) -> str:
    """Which points of raw surveys were taken as ground: class_2 or as_is; empty where it was extracted."""
    ground = record.get("parameters", {}).get("ground", {}).get("ground")
    return ground if ground in ("class_2", "as_is") else ""


def ground_maps(clouds: Sequence[Path], names: Sequence[str]) -> list[Picture]:
    """Ground returns a square metre of classified clouds, all over the same place and on one scale.

    Squares are those of the cover; squares with returns of which none is ground have a colour of their own.

    Raises:
        InputError: a cloud is damaged.
    """
    found = [_squares(cloud) for cloud in clouds]
    if not found:
        return []
    low = np.array([[c.column.min(), c.row.min()] for c, _ in found]).min(axis=0)
    high = np.array(
        [[(c.column + c.side / FINEST_SQUARE_M).max(), (c.row + c.side / FINEST_SQUARE_M).max()] for c, _ in found]
    )
    factor = 1
    while (high.max(axis=0) - low).max() > factor * _MAX_PIXELS:
        factor *= 2
    low = low // factor * factor
    columns, rows = (np.ceil((high.max(axis=0) - low) / factor)).astype(int).tolist()
    densities = [painted(c, count, (int(low[0]), int(low[1])), (rows, columns), factor) for c, count in found]
    reached = np.concatenate([d[d > 0] for d in densities])
    limit = float(np.percentile(reached, 98)) if reached.size else 1.0
    cell = FINEST_SQUARE_M * factor
    grid = Grid(float(low[0]) * FINEST_SQUARE_M, float(low[1]) * FINEST_SQUARE_M + rows * cell, cell, rows, columns)
    pictures = []
    for density, name in zip(densities, names, strict=True):
        image = colours_at(SEQUENTIAL, np.nan_to_num(density) / limit)
        image[np.isnan(density)] = 255
        image[density == 0] = NO_GROUND
        words = f"Map of the ground returns of {name}; places with returns of which none is ground stand out"
        pictures.append(panel(image[::-1], grid, words, legend=limit, boxes=[("no ground return", NO_GROUND)]))
    return pictures


def painted(
    cells: CoverCells, ground: Index, corner: tuple[int, int], shape: tuple[int, int], factor: int = 1
) -> Float:
    """(rows, columns) ground returns a m² from south to north; 0 where only other returns are, NaN without any.

    Args:
        ground: (m,) ground returns of each square.
        corner: column and row of the south-west corner, in steps of ``FINEST_SQUARE_M``; whole multiples of ``factor``.
        factor: side of a pixel in these steps, a power of two.
    """
    total, area = np.zeros(shape), np.zeros(shape)
    sizes = np.rint(cells.side / FINEST_SQUARE_M).astype(np.int64)
    for size in np.unique(sizes).tolist():
        chosen = sizes == size
        column, row = (cells.column[chosen] - corner[0]) // factor, (cells.row[chosen] - corner[1]) // factor
        across = max(1, size // factor)
        for i in range(across):
            for j in range(across):
                np.add.at(total, (row + j, column + i), ground[chosen] / across**2)
                np.add.at(area, (row + j, column + i), (size * FINEST_SQUARE_M / across) ** 2)
    return np.where(area > 0, total / np.where(area > 0, area, 1.0), np.nan)


def heights_chart(surveys: Sequence[tuple[str, Mapping[str, Any]]]) -> Picture | None:
    """Returns by their height over the ground, one panel for each survey, side by side; None without any.

    Args:
        surveys: name and ``HeightCounts`` as the run record has them.
    """
    if not surveys:
        return None
    shares = []
    for _, heights in surveys:
        whole = sum(heights["returns"]) + heights["below"] + heights["above"]
        shares.append([100.0 * np.array(heights[name]) / max(whole, 1) for name in ("returns", "ground")])
    first = surveys[0][1]
    edges = first["from_m"] + first["bin_m"] * np.arange(len(first["returns"]) + 1)
    seen = np.flatnonzero(np.max([every for every, _ in shares], axis=0) > 0.05)
    lowest, highest = (edges[seen[0]], edges[seen[-1] + 1]) if seen.size else (0.0, 1.0)
    most = max(float(every.max()) for every, _ in shares) or 1.0
    sheet = Sheet(_PANEL_INCHES * len(surveys), 3.0)
    for number, ((name, _), (every, ground)) in enumerate(zip(surveys, shares, strict=True)):
        axes = sheet.axes(0.6 + number * _PANEL_INCHES, 0.5, _PANEL_INCHES - 0.8, 2.15)
        axes.stairs(every, edges, orientation="horizontal", fill=True, color=_GREY, label=say("all returns"))
        axes.stairs(ground, edges, orientation="horizontal", fill=True, color=_DARK, label=say("ground"))
        axes.axhline(0.0, color=INK, lw=0.6)
        finish(axes, "share of the returns (%)", "height over the ground (m)")
        axes.set_xlim(0.0, 1.05 * most)
        axes.set_ylim(min(lowest, -0.1), max(highest, 0.5))
        axes.legend(loc="upper right", frameon=False, prop=fonts(SMALL), handlelength=1.2)
        sheet.text(0.6 + number * _PANEL_INCHES, 2.8, name, 8.0, weight="bold")
    shares_in_words = "; ".join(
        f"{100.0 * sum(h['ground']) / max(sum(h['returns']) + h['below'] + h['above'], 1):.0f} % of {name} is ground"
        for name, h in surveys
    )
    return drawing(
        sheet.figure,
        f"Histograms of the returns by their height over the ground, all and those of it: {shares_in_words}",
    )


def _of_survey(facts: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The figures of cover and flight strips, and the classified cloud where it is kept."""
    name = facts.get("classified")
    # a run at work has what it keeps from earlier ones in the folder around its own
    places = [inside(place, name) for place in (folder, folder.parent)] if name else []
    cover = facts.get("cover")
    cloud = next((path for path in places if path and path.is_file()), None)
    return {"cover": cover or None, "cloud": cloud, "strips": facts.get("strips") or None}


def _squares(cloud: Path) -> tuple[CoverCells, Index]:
    """The squares of a classified cloud and the ground returns in each."""
    header = preflight(cloud)
    xy, ground = np.empty((header.count, 2)), np.empty(header.count, dtype=np.bool_)
    selection = DecompressionSelection.XY_RETURNS_CHANNEL | DecompressionSelection.CLASSIFICATION
    done = 0
    for records in read_records(header, selection=selection):
        part = slice(done, done + len(records))
        for axis, field in enumerate("XY"):
            xy[part, axis] = records[field] * header.scales[axis] + header.offsets[axis]
        ground[part] = np.asarray(records["classification"]) == GROUND
        done += len(records)
    cells = cover_cells(xy)
    return cells, np.bincount(cells.index[ground], minlength=len(cells.side))
