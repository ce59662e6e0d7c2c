"""Heatmap: what each pixel shows, and that no part of the annotated map covers another."""

from __future__ import annotations

import itertools
from datetime import date
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
import rasterio
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from PIL import Image
from pyproj import CRS
from slopewatch.engine.core.errors import EngineError
from slopewatch.engine.grid.geotiff import write_rgba
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.maps.figure import check_png, make_figure, shrunk
from slopewatch.engine.maps.heatmap import write_heatmap_png
from slopewatch.engine.maps.heatmap_image import Heatmap, make_heatmap
from slopewatch.engine.maps.map_parts import round_length, wrap
from slopewatch.engine.maps.palette import diverging_colours
from slopewatch.engine.maps.top_view import TopView, top_view_grid
from slopewatch.interface.parameters import HeatmapParameters, ZoneParameters
from slopewatch.tests.builders.change_zones import zones_of

GRID = Grid(west=500000.0, north=4000040.0, cell=0.5, rows=80, columns=120)
GREEN = (60, 120, 40)


def change(grid: Grid = GRID) -> np.ndarray:
    """Lowered in the north-west, raised in the south-east, no data in the south-west, small change elsewhere."""
    dz = np.full(grid.shape, 0.01)
    r, c = grid.rows, grid.columns
    dz[r // 8 : r // 3, c // 8 : c // 3] = -0.3
    dz[2 * r // 3 : 7 * r // 8, 2 * c // 3 : 7 * c // 8] = 0.15
    dz[3 * r // 4 :, : c // 4] = np.nan
    return dz


def heatmap(dz: np.ndarray, grid: Grid = GRID, pixel: float | None = None, **parameters: float) -> Heatmap:
    """Over an evenly green top view, with a level of detection of 0.05 m."""
    view_grid = top_view_grid(grid, pixel or grid.cell)
    rgba = np.full((*view_grid.shape, 4), 255, dtype=np.uint8)
    rgba[..., :3] = GREEN
    rgba[0, 0] = 0
    level = np.full(dz.shape, 0.05)
    view = TopView(rgba, view_grid, "rgb")
    significant = np.nan_to_num(np.abs(dz)) > level
    return make_heatmap(dz, significant, level, grid, view, HeatmapParameters(**parameters))


def zones(dz: np.ndarray, grid: Grid = GRID) -> gpd.GeoDataFrame:
    level = np.full(dz.shape, 0.05)
    count = np.ones(dz.shape, int)
    significant = np.nan_to_num(np.abs(dz)) > level
    parameters = ZoneParameters(minimum_area=0.0, minimum_confidence=0.0)
    return zones_of(dz, significant, level, level / 2, count, grid, CRS(32651), parameters).frame


def test_colours_tell_the_sign_at_their_place_in_the_raster(tmp_path: Path) -> None:
    found = heatmap(change(), pixel=0.2)
    write_rgba(tmp_path / "heatmap.tif", found.rgba, found.grid, CRS(32651))
    with rasterio.open(tmp_path / "heatmap.tif") as source:
        places = [(500010.1, 4000030.1), (500045.1, 4000010.1), (500007.1, 4000003.1), (500030.1, 4000020.1)]
        lowered, raised, missing, still = (value.astype(int) for value in source.sample(places))
    assert lowered[0] > lowered[2] + 40
    assert raised[2] > raised[0] + 40
    assert missing.tolist() == [*GREEN, 255]
    assert np.ptp(still[:3]) < 0.5 * np.ptp(GREEN)  # greyer than the view


def test_opacity_from_the_top_view_alone_to_the_change_alone() -> None:
    dz = change()
    lowered = (15, 20)
    grey = round(0.2126 * GREEN[0] + 0.7152 * GREEN[1] + 0.0722 * GREEN[2])
    pure = diverging_colours(np.array([-0.3]), 0.5)[0]
    assert heatmap(dz, opacity=0.0).rgba[lowered].tolist() == [grey, grey, grey, 255]
    assert heatmap(dz, opacity=1.0, colour_range=0.5).rgba[lowered][:3].tolist() == pure.tolist()
    half = heatmap(dz, opacity=0.5, colour_range=0.5).rgba[lowered][:3].astype(float)
    assert half == pytest.approx((pure + float(grey)) / 2, abs=1)


def test_transparent_only_where_nothing_is_known() -> None:
    dz = change()
    dz[0, 0] = np.nan
    alpha = heatmap(dz).rgba[..., 3]
    assert alpha[0, 0] == 0
    assert (alpha.ravel()[1:] == 255).all()
    dz[0, 0] = -0.3  # no top view, but a change
    assert heatmap(dz).rgba[0, 0, 3] == 255


def test_level_and_limit() -> None:
    found = heatmap(change())
    assert (found.limit, found.level) == (0.3, pytest.approx(0.05))
    assert heatmap(change(), colour_range=1.25).limit == 1.25
    assert heatmap(np.full(GRID.shape, 0.01)).limit == pytest.approx(0.1)


def test_no_common_cell_shows_the_top_view_alone() -> None:
    found = heatmap(np.full(GRID.shape, np.nan))
    assert (found.rgba.reshape(-1, 4)[1:] == (*GREEN, 255)).all()
    assert found.significant_cells == 0


def drawn(figure: Figure) -> np.ndarray:
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[..., :3].astype(int)


def test_the_map_is_north_up() -> None:
    figure = make_figure(heatmap(change(), opacity=1.0))
    picture = drawn(figure)
    axes = next(a for a in figure.axes if a.get_label() == "map")

    def pixel(x: float, y: float) -> np.ndarray:
        column, row = axes.transData.transform((x, y))
        return picture[picture.shape[0] - 1 - round(row), round(column)]

    lowered, raised = pixel(500010.0, 4000030.0), pixel(500045.0, 4000010.0)
    assert lowered[0] > lowered[2] + 40
    assert raised[2] > raised[0] + 40


def scale_bar(figure: Figure) -> list[Bbox]:
    """Extents of its two halves."""
    figure.canvas.draw()  # only then do they know where they are
    return [a.get_window_extent() for a in figure.get_children() if a.get_label() == "scale bar"]


def test_the_scale_bar_is_as_long_as_it_says() -> None:
    figure = make_figure(heatmap(change()))
    axes = {a.get_label(): a.get_window_extent() for a in figure.axes}
    metres = Bbox.union(scale_bar(figure)).width / axes["map"].width * 60.0
    texts = [t.get_text() for t in figure.texts]
    assert f"{metres:g} m" in [f"{float(t.split()[0]):g} m" for t in texts if t.endswith(" m")]
    assert round(metres, 6) in (5.0, 10.0, 20.0)


def test_the_legend_is_centred_on_zero() -> None:
    figure = make_figure(heatmap(change()))
    texts = {t.get_text() for t in figure.findobj(Text)}
    assert {"−0.3", "−0.15", "0", "+0.15", "+0.3"} <= texts
    picture = drawn(figure)
    extent = next(a for a in figure.axes if a.get_label() == "legend").get_window_extent()
    row = picture.shape[0] - 1 - round((extent.y0 + extent.y1) / 2)
    strip = picture[row, round(extent.x0) + 3 : round(extent.x1) - 3]
    left, right, middle = strip[0], strip[-1], strip[len(strip) // 2]
    assert left[0] > left[2] + 20
    assert right[2] > right[0] + 20
    assert np.ptp(middle) == 0
    grey = np.flatnonzero(np.ptp(strip, axis=1) == 0)
    # the grey band is the level's share of the range, as wide on both sides
    assert len(grey) / len(strip) == pytest.approx(0.05 / 0.3, abs=0.02)
    assert grey[0] == pytest.approx(len(strip) - 1 - grey[-1], abs=2)


SHAPES = {
    "normal": (80, 120, 0.5),
    "strip": (30, 1500, 0.2),
    "tall": (700, 150, 0.1),
    "column": (3000, 40, 0.1),
    "tiny": (12, 12, 0.05),
    "vast": (1100, 1300, 2.0),
    "flat tiny": (6, 60, 0.02),
}


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES.keys())
@pytest.mark.parametrize("name", ["", "Expressway S4, northern cutting between K12+300 and K12+980, left-hand side"])
def test_no_text_covers_another_or_is_cut(shape: tuple[int, int, float], name: str) -> None:
    rows, columns, cell = shape
    grid = Grid(west=499998.2, north=4000071.4, cell=cell, rows=rows, columns=columns)
    dz = change(grid)
    # many small zones crowd the labels
    dz[rows // 2 : rows // 2 + 3 : 1, columns // 2 :: 8] = 0.2
    dz[rows // 2 : rows // 2 + 3 : 1, columns // 2 + 1 :: 8] = 0.2
    outlines = zones(dz, grid)
    figure = make_figure(heatmap(dz, grid), zones=outlines, epochs=("2024-01-01", "2024-04-01"), name=name)
    figure.canvas.draw()
    page = figure.bbox
    texts = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text()]
    boxes = [(t.get_text(), t.get_window_extent()) for t in texts]
    for text, extent in boxes:
        inside = extent.x0 >= 0 and extent.y0 >= 0 and extent.x1 <= page.x1 and extent.y1 <= page.y1
        assert inside, text
    for (a, one), (b, other) in itertools.combinations(boxes, 2):
        assert not (one.x0 < other.x1 and other.x0 < one.x1 and one.y0 < other.y1 and other.y0 < one.y1), (a, b)
    parts = [a for a in figure.axes if a.get_label() in ("map", "legend")]
    extents = [*(a.get_window_extent() for a in parts), Bbox.union(scale_bar(figure))]
    assert len(extents) == 3
    for a, b in itertools.combinations(extents, 2):
        assert not a.overlaps(b)
    # the page's own texts keep off the map
    frame = next(a for a in parts if a.get_label() == "map").get_window_extent()
    for text in figure.texts:
        assert not text.get_window_extent().overlaps(frame), text.get_text()
    assert max(figure.get_size_inches()) < 20
    written = {text for text, _ in boxes}
    assert outlines["zone_id"][0] in written
    assert f"{len(outlines)} zones." in " ".join(written)


def test_png_is_written_and_not_blank(tmp_path: Path) -> None:
    dz = change()
    for name in ("a.png", "b.png"):
        write_heatmap_png(tmp_path / name, heatmap(dz), zones=zones(dz), epochs=("2024-01-01", "2024-04-01"))
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as picture:
        assert max(picture.size) <= 3000
        assert len(picture.convert("RGB").getcolors(10**7)) > 20
    Image.new("RGB", (20, 20), "white").save(tmp_path / "white.png")
    with pytest.raises(EngineError, match="blank"):
        check_png(tmp_path / "white.png")


def test_no_change_is_said_in_the_right_words() -> None:
    quiet = make_figure(heatmap(np.full(GRID.shape, 0.01)), zones=zones(np.zeros(GRID.shape)))
    said = " ".join(t.get_text() for t in quiet.texts)
    assert "No change above the level of detection" in said
    assert "safe" not in said


def test_large_pictures_shrink_without_dark_edges() -> None:
    rgba = np.zeros((90, 41, 4), dtype=np.uint8)
    rgba[:, :20] = (200, 100, 50, 255)
    small, factor = shrunk(rgba, 30)
    assert (small.shape, factor) == ((30, 14, 4), 3)
    assert small[5, 3].tolist() == [200, 100, 50, 255]
    assert small[5, 6].tolist() == [200, 100, 50, 170]  # two of three columns are there
    assert small[5, 9].tolist() == [0, 0, 0, 0]
    assert shrunk(rgba, 90)[0] is rgba


def test_round_lengths_and_wrapping() -> None:
    assert [round_length(v) for v in (0.0213, 9.99, 10.0, 49.0, 512.0)] == [0.02, 5.0, 10.0, 20.0, 500.0]
    assert wrap("one two three", 8.0, len) == ["one two", "three"]
    assert wrap("one\u00a0two three", 8.0, len) == ["one\u00a0two", "three"]
    (cut,) = wrap("incomprehensibilities", 8.0, len)
    assert cut.startswith("incomp")
    assert cut.endswith("…")
    assert len(cut) <= 8


def test_dates_in_the_title() -> None:
    days = (date(2024, 1, 1).isoformat(), date(2024, 4, 1).isoformat())
    titles = [t.get_text() for t in make_figure(heatmap(change()), epochs=days).texts]
    assert "Elevation change, 2024-01-01\u00a0to\u00a02024-04-01" in titles


def test_a_picture_in_lines_is_that_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    dz = change()
    whole = heatmap(dz)
    monkeypatch.setattr("slopewatch.engine.maps.heatmap_image._AT_ONCE", 3 * GRID.columns)
    lines = heatmap(dz)
    assert np.array_equal(lines.rgba, whole.rgba)
    assert lines.backdrop == pytest.approx(whole.backdrop)
