"""Templates: what is escaped, and what may be missing."""

from __future__ import annotations

from pathlib import Path

import pytest
from jinja2 import UndefinedError
from slopewatch.engine.core.templates import render


@pytest.mark.parametrize(("kind", "shown"), [("html", "&lt;b&gt; &amp;"), ("qml", "&lt;b&gt; &amp;"), ("md", "<b> &")])
def test_values_are_escaped_except_in_markdown(tmp_path: Path, kind: str, shown: str) -> None:
    (tmp_path / f"page.{kind}.j2").write_text("{{ words }}\n", encoding="utf-8")
    assert render(tmp_path / f"page.{kind}.j2", words="<b> &") == f"{shown}\n"


def test_what_nobody_gives_is_an_error_except_in_html(tmp_path: Path) -> None:
    for kind in ("html", "qml", "md"):
        (tmp_path / f"page.{kind}.j2").write_text("{{ record.missing }}", encoding="utf-8")
    assert render(tmp_path / "page.html.j2", record={}) == ""
    for kind in ("qml", "md"):
        with pytest.raises(UndefinedError, match="missing"):
            render(tmp_path / f"page.{kind}.j2", record={})
