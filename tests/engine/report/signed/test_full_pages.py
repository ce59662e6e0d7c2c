"""Wherever the text before it ends, the last page is filled and has the signatures, and the pages are counted right."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import pytest
from slopewatch.engine.report.signed import blocks, parts
from slopewatch.engine.report.signed.blocks import Document
from slopewatch.engine.report.signed.details import Details
from slopewatch.engine.report.signed.typesetting import typeset
from slopewatch.tests.builders.signed_folder import Pages

HEAD = {"title": "t", "authors": [], "running": "r", "foot": "f", "page": ["Page ", " of ", ""]}


@pytest.mark.parametrize("said", ["", "Remark. " * 60, "备注很长。" * 145])
@pytest.mark.parametrize("lines", [1, 20, 27, 29, 31, 40, 48, 50])
def test_signatures_stand_on_a_full_last_page(tmp_path: Path, lines: int, said: str) -> None:
    document = Document()
    document.blocks = [blocks.heading("Before"), *(blocks.paragraph(f"line {n}") for n in range(lines))]
    document.blocks += parts.closing(Details({"report_remarks": said, "actions": said}, ("2024",)))
    typeset(document, HEAD, date(2026, 11, 23), tmp_path / "a.pdf")
    pages = Pages(tmp_path / "a.pdf")
    count = len(pages.texts)
    assert count <= 3
    assert all(f"Page {n} of {count}" in text for n, text in enumerate(pages.texts, 1))
    assert all(words in pages.texts[-1] for words in ("Prepared by", "Checked by", "Approved by"))
    assert "Remarks" in pages.text
    assert pages.text.count("Actions") == 1
    assert pages.lowest_ink[-1] > 0.95
    assert min(pages.lowest_ink) >= 0.45


def test_terms_are_divided_into_columns_of_like_length() -> None:
    made = blocks.terms([("a", "x" * 400), ("b", "x" * 100), ("c", "x" * 100), ("d", "x" * 100)])
    assert [name for name, _ in made["left"]] == ["a"]
    assert [name for name, _ in made["right"]] == ["b", "c", "d"]
    assert blocks.terms([]) == {"kind": "terms", "left": [], "right": []}
