"""Hatching over what was not seen, on the drawn map; the raster's style in QGIS."""

from __future__ import annotations

import io
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.grid.geotiff import write_classes
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.maps.figure import make_figure
from slopewatch.engine.maps.heatmap_image import Heatmap, Unseen, make_heatmap
from slopewatch.engine.maps.palette import SEEN
from slopewatch.engine.maps.qgis_styles import seen_qml
from slopewatch.engine.maps.top_view import TopView
from slopewatch.engine.maps.unseen import WORDS, read_unseen
from slopewatch.interface.seen import COMPARED, LABELS, NOT_IN_LATER, OUTSIDE, RASTER, TOO_FEW

GRID = Grid(west=500000.0, north=4000020.0, cell=0.5, rows=40, columns=60)


def heatmap() -> Heatmap:
    """Nothing changed and nothing was seen in the eastern half."""
    dz = np.zeros(GRID.shape)
    dz[:, 30:] = np.nan
    view = TopView(np.full((*GRID.shape, 4), 255, dtype=np.uint8), GRID, "none")
    return make_heatmap(dz, np.zeros(GRID.shape, dtype=bool), np.full(GRID.shape, 0.05), GRID, view)


def drawn(picture: Heatmap) -> tuple[np.ndarray, list[str]]:
    """The map's own pixels (rows, columns, 3), and the words of the figure."""
    figure = make_figure(picture)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=100)
    image = np.array(Image.open(stream).convert("RGB"))
    (axes,) = [one for one in figure.axes if one.get_label() == "map"]
    box, rows = axes.get_position(), image.shape[0]
    left, right = (round(side * image.shape[1]) for side in (box.x0, box.x1))
    top, bottom = (round((1 - side) * rows) for side in (box.y1, box.y0))
    return image[top + 3 : bottom - 3, left + 3 : right - 3], [text.get_text() for text in figure.texts]


def test_what_was_not_seen_is_hatched_and_named_and_only_that() -> None:
    unseen = np.zeros(GRID.shape, dtype=bool)
    unseen[:, 30:] = True
    pixels, words = drawn(replace(heatmap(), unseen=Unseen(unseen, GRID)))
    ochre = pixels[..., 0].astype(int) - pixels[..., 2] > 20  # nothing else in this picture has a colour
    middle = ochre.shape[1] // 2
    assert ochre[:, middle + 3 :].mean() > 0.95
    assert not ochre[:, : middle - 3].any()
    dark = pixels[:, middle + 3 :].sum(axis=2) < 450
    # stripes, neither a veil nor a solid area; each row of pixels crosses many of them
    assert 0.15 < dark.mean() < 0.5
    assert np.median((np.diff(dark.astype(int), axis=1) == 1).sum(axis=1)) > 20
    assert WORDS in words


def test_a_map_on_which_all_was_seen_has_no_such_entry() -> None:
    for picture in (heatmap(), replace(heatmap(), unseen=Unseen(np.zeros(GRID.shape, dtype=bool), GRID))):
        pixels, words = drawn(picture)
        assert not (np.ptp(pixels, axis=2) > 20).any()
        assert WORDS not in words


def test_the_raster_is_read_again(tmp_path) -> None:
    classes = np.full(GRID.shape, COMPARED, dtype=np.uint8)
    classes[:, :5], classes[:10, 30:] = OUTSIDE, NOT_IN_LATER
    looks = {one: (LABELS[one], SEEN[one]) for one in LABELS}
    path = tmp_path / RASTER
    assert read_unseen(path) is None
    write_classes(path, classes, GRID, CRS.from_epsg(32651), looks, description="classes")
    found = read_unseen(path)
    assert found is not None
    assert found.grid == GRID
    assert np.array_equal(found.cells, classes == NOT_IN_LATER)
    path.write_bytes(b"no raster")
    with pytest.raises(InputError, match=RASTER):
        read_unseen(path)


def test_the_style_names_what_occurs_and_leaves_what_was_compared_clear() -> None:
    root = ElementTree.fromstring(seen_qml([OUTSIDE, COMPARED, NOT_IN_LATER, TOO_FEW]))
    entries = {int(entry.attrib["value"]): entry.attrib for entry in root.iter("paletteEntry")}
    assert {value: entry["label"] for value, entry in entries.items()} == {
        NOT_IN_LATER: LABELS[NOT_IN_LATER],
        TOO_FEW: LABELS[TOO_FEW],
    }
    assert len({entry["color"] for entry in entries.values()}) == 2


def test_the_legend_looks_as_the_map_where_the_picture_has_little_below() -> None:
    """A tenth of the top view is there, and dark; the map is white elsewhere, and so are the legend's boxes."""
    view = np.zeros((*GRID.shape, 4), dtype=np.uint8)
    view[::10] = 60, 60, 60, 255
    dz = np.zeros(GRID.shape)
    dz[:, 30:] = np.nan
    picture = make_heatmap(
        dz, np.zeros(GRID.shape, dtype=bool), np.full(GRID.shape, 0.05), GRID, TopView(view, GRID, "none")
    )
    figure = make_figure(replace(picture, unseen=Unseen(np.isnan(dz), GRID)))
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=200)
    image = np.array(Image.open(stream).convert("RGB")).astype(float)

    def colour(label: str, left: float) -> np.ndarray:
        """Mean colour of axes within their frame, from a share of their width on."""
        (axes,) = [one for one in figure.axes if one.get_label() == label]
        box, (rows, columns) = axes.get_position(), image.shape[:2]
        part = image[
            round((1 - box.y1) * rows) + 3 : round((1 - box.y0) * rows) - 3,
            round((box.x0 + left * box.width) * columns) + 3 : round(box.x1 * columns) - 3,
        ]
        return part.mean(axis=(0, 1))

    assert colour("not seen", 0.0) == pytest.approx(colour("map", 0.5), abs=12)
