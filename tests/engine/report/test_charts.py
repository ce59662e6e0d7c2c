"""Charts of the report against the figures that they are given."""

from __future__ import annotations

from datetime import date

import numpy as np
import pytest
from matplotlib.dates import date2num
from slopewatch.engine.report import charts

DAYS = ["2024-05-01", "2024-06-01", "2024-08-01"]


def _row(day: str, change: float, change_error: float, volume: float, volume_error: float) -> dict:
    return {
        "epoch": day,
        "dz_mean_m": change,
        "dz_err_m": change_error,
        "vol_net_m3": volume,
        "vol_err_m3": volume_error,
    }


@pytest.fixture
def drawn(monkeypatch):
    """The axes of the chart that is drawn, and its text."""
    kept = {}

    def keep(figure, text):
        kept.update(axes=figure.axes, text=text)
        return charts.Picture("", text, 1, 1)

    monkeypatch.setattr(charts, "drawing", keep)
    return kept


def test_courses_are_drawn_with_their_bands_on_the_days(drawn):
    course = {
        "S002": [_row(DAYS[1], -0.1, 0.01, -0.5, 0.05), _row(DAYS[2], -0.2, 0.02, -1.2, 0.1)],
        "S001": [{"epoch": DAYS[1]}, _row(DAYS[2], 0.05, 0.01, 0.3, 0.04)],
    }
    record = {"dates": DAYS, "zones": [{"zone_id": "S002"}, {"zone_id": "S001"}], "course": course}
    assert charts.course_chart(record) is not None
    (axes,) = drawn["axes"]
    at = date2num([date.fromisoformat(d) for d in DAYS])
    zones = {"S002": ([0, 1, 2], [0, -0.1, -0.2], [0, 0.01, 0.02]), "S001": ([0, 2], [0, 0.05], [0, 0.01])}
    lines = {line.get_label(): line for line in axes.get_lines()}
    for band, (name, (days, middle, error)) in zip(axes.collections, zones.items(), strict=True):
        np.testing.assert_allclose(lines[name].get_xdata(), at[days])
        np.testing.assert_allclose(lines[name].get_ydata(), middle)
        assert tuple(band.get_facecolor()[0][:3]) == pytest.approx(_rgb(lines[name]))
        corners = band.get_paths()[0].vertices
        for day, value, sigma in zip(at[days], middle, error, strict=True):
            spread = corners[np.isclose(corners[:, 0], day), 1]
            assert spread.min() == pytest.approx(value - 1.959964 * sigma)
            assert spread.max() == pytest.approx(value + 1.959964 * sigma)
    verticals = {float(line.get_xdata()[0]) for line in axes.get_lines() if len(set(line.get_xdata())) == 1}
    assert verticals == set(at.tolist())
    assert "S002 changed by -0.200 m; S001 changed by +0.050 m" in drawn["text"]


def _rgb(line) -> tuple[float, ...]:
    from matplotlib.colors import to_rgb

    return to_rgb(line.get_color())


def test_the_first_eight_zones_are_drawn_and_none_without_any(drawn):
    names = [f"S{k:03d}" for k in range(11)]
    record = {
        "dates": DAYS[:2],
        "zones": [{"zone_id": name} for name in names],
        "course": {name: [_row(DAYS[1], 0.1, 0.01, 1.0, 0.1)] for name in names},
    }
    charts.course_chart(record)
    assert [t.get_text() for t in drawn["axes"][0].get_legend().get_texts()] == names[:8]
    assert charts.course_chart({"zones": [], "course": {}, "dates": DAYS}) is None
    assert charts.course_chart({"zones": []}) is None


@pytest.mark.parametrize("angle", [0, 17, 30, 35, 45, 60])
def test_the_ribbon_is_whole_on_lines_across_the_cells_and_breaks_where_a_cell_has_no_level(angle: float) -> None:
    """Cells of a metre as a line meets them; one in the middle without a level."""
    ahead = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    stations = np.arange(0.0, 60.0)
    cells = np.unique(np.floor(stations[:, np.newaxis] * ahead), axis=0)
    distance = np.sort((cells + 0.5) @ ahead)
    level = np.full(len(distance), 0.1)
    edges, heights = charts._ribbon(distance, level)
    assert np.count_nonzero(np.isnan(heights)) == 1, "after the last"
    assert edges[0] <= distance[0]
    level[len(level) // 2] = np.nan
    edges, heights = charts._ribbon(distance, level)
    assert np.count_nonzero(np.isnan(heights)) == 2
