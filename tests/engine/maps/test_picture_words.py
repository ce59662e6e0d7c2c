"""Words in pictures: in the language of the run where a font has its letters, English where none has."""

from __future__ import annotations

import io
import re
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from matplotlib import font_manager
from matplotlib.dates import date2num
from matplotlib.figure import Figure
from matplotlib.text import Text
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.maps import picture_words
from slopewatch.engine.maps.figure import make_figure
from slopewatch.engine.maps.heatmap import write_heatmap_png
from slopewatch.engine.maps.heatmap_image import Heatmap, make_heatmap
from slopewatch.engine.maps.map_parts import Sheet, wrap
from slopewatch.engine.maps.picture_words import NO_FONT, say, say_missing_font
from slopewatch.engine.maps.top_view import TopView
from slopewatch.engine.report import charts
from slopewatch.tests.builders.chinese_font import chinese_letters, font_file

ENGLISH = re.compile(r"[A-Za-z]{3,}")
GRID = Grid(west=500000.0, north=4000040.0, cell=0.5, rows=80, columns=120)


@pytest.fixture
def machine(monkeypatch, tmp_path):
    """Call it with the fonts of a machine, by family and letters; the language of its run is Chinese."""

    def set_up(listed: dict[str, str], not_listed: dict[str, str] | None = None) -> None:
        latin = [font for font in font_manager.fontManager.ttflist if font.name.startswith("DejaVu")]
        monkeypatch.setattr(font_manager.fontManager, "ttflist", latin)
        paths = {name: font_file(tmp_path / f"{name}.ttf", name, letters) for name, letters in listed.items()}
        for path in paths.values():
            font_manager.fontManager.addfont(path)
        later = [font_file(tmp_path / f"{name}.ttf", name, letters) for name, letters in (not_listed or {}).items()]
        monkeypatch.setattr(font_manager, "findSystemFonts", lambda: [str(p) for p in (*paths.values(), *later)])

    def forget() -> None:
        picture_words.fonts.cache_clear()
        picture_words.chinese_font.cache_clear()
        picture_words._asked.clear()
        font_manager.fontManager._findfont_cached.cache_clear()

    monkeypatch.setenv("SLOPEWATCH_LANGUAGE", "zh_CN")
    forget()
    yield set_up
    monkeypatch.undo()
    forget()


class Log(Progress):
    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def show(self, level: str, message: str) -> None:
        self.lines.append(message)


def picture() -> Heatmap:
    dz = np.full(GRID.shape, 0.01)
    dz[10:30, 10:30] = -0.3
    view = TopView(np.full((*GRID.shape, 4), 255, dtype=np.uint8), GRID, "rgb")
    return make_heatmap(dz, np.abs(dz) > 0.05, np.full(GRID.shape, 0.05), GRID, view)


def words(figure: Figure) -> list[str]:
    figure.canvas.draw()
    return [text for text in (t.get_text() for t in figure.findobj(Text)) if text]


def test_a_map_is_in_the_language_of_the_run_and_every_letter_is_drawn(machine):
    machine({"SimHei": chinese_letters()})
    said = words(make_figure(picture(), epochs=("2024-01-01", "2024-04-01")))
    assert "高程变化，2024-01-01至2024-04-01" in said
    assert {"降低", "抬升", "灰色覆盖：已测量，但"} <= set(said)
    assert [text for text in said if ENGLISH.search(text)] == []


def test_without_a_font_the_words_stay_english_and_the_log_says_so_once(machine, tmp_path):
    machine({})
    log = Log()
    for name in ("a.png", "b.png"):
        write_heatmap_png(tmp_path / name, picture(), progress=log)
    say_missing_font(log)
    assert log.lines == [NO_FONT]
    said = words(make_figure(picture(), epochs=("2024-01-01", "2024-04-01")))
    assert "Elevation change, 2024-01-01\u00a0to\u00a02024-04-01" in said
    assert not any(re.search("[\u4e00-\u9fff]", text) for text in said)


def test_an_english_run_says_nothing_of_fonts(machine, monkeypatch):
    machine({})
    monkeypatch.setenv("SLOPEWATCH_LANGUAGE", "en")
    log = Log()
    say_missing_font(log)
    assert log.lines == []
    assert say("hazard zone") == "hazard zone"


def test_a_font_without_the_letters_is_passed_over(machine):
    machine({"Microsoft YaHei": "检测", "WenQuanYi Zen Hei": chinese_letters()})
    assert picture_words.chinese_font() == "WenQuanYi Zen Hei"


def test_the_first_of_the_usual_ones_is_taken_and_others_are_not(machine):
    machine({name: chinese_letters() for name in ("Noto Sans CJK JP", "A font of my own", "PingFang SC")})
    assert picture_words.chinese_font() == "PingFang SC"


def test_a_font_that_was_installed_after_matplotlib_looked_is_found(machine):
    machine({}, not_listed={"Noto Sans CJK SC": chinese_letters()})
    assert picture_words.chinese_font() == "Noto Sans CJK SC"
    assert say("hazard zone") == "隐患区"


def test_days_have_no_english_months(machine):
    machine({"SimHei": chinese_letters()})
    axes = Sheet(6.0, 3.0).axes(0.5, 0.5, 5.0, 2.0)
    axes.set_xlim(*date2num([date(2024, 1, 15), date(2024, 9, 20)]))
    picture_words.date_axis(axes.xaxis)
    shown = words(axes.figure)
    assert "2024-03" in shown
    assert [text for text in shown if ENGLISH.search(text)] == []


def test_a_chart_of_the_report_is_chinese(machine, monkeypatch):
    machine({"SimHei": chinese_letters()})
    kept = []
    monkeypatch.setattr(charts, "drawing", lambda figure, text: kept.append(figure))
    row = {"epoch": "2024-08-01", "dz_mean_m": -0.1, "dz_err_m": 0.01, "vol_net_m3": -0.5, "vol_err_m3": 0.05}
    days = ["2024-05-01", "2024-08-01"]
    charts.course_chart({"dates": days, "zones": [{"zone_id": "S1"}], "course": {"S1": [row]}})
    facts = {"length_m": 10.0, "dz_min_m": None, "dz_max_m": None}
    charts.profile_chart(facts, None, ("2024-05-01", "2024-08-01"))
    shown = [text for figure in kept for text in words(figure)]
    assert {"平均变化（m）", "高程（m）", "沿线距离（m）", "未测量"} <= set(shown)
    assert [text for text in shown if ENGLISH.search(text)] == []
    # as paths, which need the letters, too
    kept[0].savefig(io.BytesIO(), format="svg")


def test_chinese_lines_break_between_letters_and_never_before_a_full_stop():
    lines = wrap("红色表示降低超过检测限，蓝色表示抬升。 3 zones", 8.0, len)
    assert lines == ["红色表示降低超过", "检测限，蓝色表示", "抬升。 3", "zones"]
    # one more letter has room, its full stop has not
    assert wrap("红色表示降低超过。", 8.0, len) == ["红色表示降低超", "过。"]


def test_the_table_of_fonts_is_read_by_its_first_column():
    table = Path(picture_words.__file__).with_name("chinese_fonts.csv").read_text(encoding="utf-8").splitlines()
    assert table[0] == "family,found on"
    assert {line.split(",")[1] for line in table[1:]} == {"Windows", "macOS", "Linux"}
