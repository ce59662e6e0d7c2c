"""The report in Chinese: words of the record and of the tables, and what must not be translated."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from slopewatch.engine.core.templates import render
from slopewatch.engine.report import compose
from slopewatch.engine.report.figures import Figures
from slopewatch.engine.series.alerts import DEFAULT_TABLE, read_alerts
from slopewatch.interface.language import translator

TEMPLATES = Path(compose.__file__).parent / "templates"
ENGLISH = re.compile(r"[A-Za-z]{3,}")


@pytest.fixture(autouse=True)
def chinese(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SLOPEWATCH_LANGUAGE", "zh_CN")


def words(page: str) -> list[str]:
    """The runs of text between the elements."""
    body = re.sub(r"<style>.*?</style>", "", page, flags=re.DOTALL)
    return [" ".join(run.split()) for run in re.sub(r"<[^>]*>", "\n", body).split("\n") if run.strip()]


def series_page(folder: Path) -> str:
    zone = {
        "zone_id": "S001", "kind": "subsidence", "alert": "inspect", "alert_level": 2, "trend": "steady",
        "alert_reason": "rate 115 mm/month, beyond 30.4 with an error chance of 0.1 %",
        "action": "Inspect on site and survey more often",
        "rate_mm_day": -3.77,
    }  # fmt: skip
    record = {
        "software": "SlopeWatch", "command": "series", "started": "2025-01-01",
        "parameters": {"inputs": {}, "screening": {"min_dip": 10.0}},
        "inputs": [{"role": role, "path": "a", "bytes": 1, "sha256": ""} for role in ("epoch 2024-05-01", "roi")],
        "metrics": {"epoch_count": 2, "zone_count": 1}, "warnings": [], "outputs": {}, "versions": {}, "zones": [zone],
    }  # fmt: skip
    (folder / "run.json").write_text(json.dumps(record))
    return compose.write_report(folder).read_text(encoding="utf-8")


def test_a_zone_keeps_the_class_that_colours_it_and_has_chinese_words(tmp_path):
    page = series_page(tmp_path)
    assert '<span class="mark subsidence"></span>沉降' in page
    assert "现场检查" in words(page)
    assert "速率115 mm/月，超出30.4，误判概率0.1 %。到现场检查并加密测量。" in page


def test_inputs_have_their_purpose_and_the_command_its_name(tmp_path):
    said = words(series_page(tmp_path))
    assert {"2024-05-01的测量", "感兴趣区", "输入"} <= set(said)
    assert any("(series" in one for one in said)


def test_gcds_labels_stand_below_their_translation():
    row = {"group": "AREAL", "quantity": "Total Area of Surface Lowering", "unit": "m²", "raw": 892.9}
    empty = dict.fromkeys(("raw_error", "thresholded", "standard_error", "low_95", "high_95", "error_percent"))
    record = {"volumes": {"rows": [row | empty], "error_model": {"model": ""}}, "metrics": {}}
    page = render(TEMPLATES / "_volumes.html.j2", "zh_CN", record=record, fig=Figures(record))
    assert '地表降低总面积 (m²)<br><span class="original" lang="en">Total Area of Surface Lowering</span>' in page
    english = render(TEMPLATES / "_volumes.html.j2", "en", record=record, fig=Figures(record))
    assert "Total Area of Surface Lowering (m²)</th>" in english


def test_the_default_alerts_have_chinese_names_and_actions():
    say = translator("zh_CN")
    for level in read_alerts(DEFAULT_TABLE):
        assert ENGLISH.findall(say(level.name) + say(level.action)) == []


def test_a_sentence_with_lists_and_a_day_before_it_is_known_as_a_whole():
    say = translator("zh_CN")
    compared = (
        "2024-05-31: Only 23 % of the slope was seen by both surveys; nothing is known of the rest, and zones and "
        "volumes leave it out; cells of 0.2 m would compare most of it."
    )
    assert say(compared) == (
        "2024-05-31：两期测量都看到的仅占边坡的23%；其余部分情况不明，不计入变化区和体积；"
        "采用0.2 m的单元可比较其中的大部分。"
    )
    covered = (
        "2024-05-01: Ground is 36 % of the points. Vegetation higher than 0.3 m covers 37 % of the slope. 3.2 % of the "
        "slope has no ground return."
    )
    assert say(covered) == ("2024-05-01：地面：占点的36 %。高于0.3 m的植被覆盖边坡的37 %。边坡的3.2 %没有地面回波。")
