"""Blocks of a report to sign, in the order in which ``templates/signed/report.typ`` lays them out.

A block is a dictionary of plain values with its ``kind``. Lengths are millimetres, sizes points. A ``share`` of 0 is a
part of a page as high as it is; parts with a share divide what the others leave.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

Block = dict[str, Any]
Cell = str | dict[str, Any]
_A_LINE = 55  # letters


@dataclass
class Document:
    """``blocks`` in their order, and ``files``: the pictures that they name."""

    blocks: list[Block] = field(default_factory=list)
    files: dict[str, bytes] = field(default_factory=dict)

    def picture(self, content: bytes, alt: str, *, height: float = 0.0, caption: str = "") -> Block:
        """A picture in the width that it has; without ``height`` as high as its part of the page allows."""
        kind = "svg" if content.lstrip()[:5] in (b"<?xml", b"<svg ") else "png" if content[:4] == b"\x89PNG" else "jpg"
        name = f"picture_{len(self.files):03d}.{kind}"
        self.files[name] = content
        return {"kind": "picture", "file": name, "alt": alt, "height": height, "caption": caption}


@dataclass(frozen=True)
class Column:
    """Of a table: ``left`` for words, ``wide`` for the one that takes what is left; else as wide as its words, or
    ``width`` in millimetres.
    """

    name: str
    left: bool = False
    wide: bool = False
    width: float = 0.0


def heading(text: str, level: int = 1, label: str = "") -> Block:
    return {"kind": "heading", "text": text, "level": level, "label": label}


def paragraph(text: str, *, small: bool = False) -> Block:
    return {"kind": "text", "text": text, "small": small}


def facts(rows: Sequence[tuple[str, str]], columns: int = 2, gap: float = 2.1, size: float = 8.2) -> Block:
    """Names and values; an empty value is a line to fill in by hand."""
    return {"kind": "facts", "rows": [list(row) for row in rows], "columns": columns, "gap": gap, "size": size}


def table(columns: Sequence[Column], rows: Sequence[Sequence[Cell]], caption: str = "", size: float = 7.6) -> Block:
    heads = [{"name": c.name, "left": c.left, "wide": c.wide, "width": c.width} for c in columns]
    return {"kind": "table", "columns": heads, "rows": [list(row) for row in rows], "caption": caption, "size": size}


def linked(text: str, label: str, mark: str = "") -> Cell:
    """A cell that leads to a label; ``mark`` is the kind of a zone, as a small square of its colour."""
    return {"text": text, "link": label, "mark": mark}


def bold(text: str) -> Cell:
    return {"text": text, "bold": True}


def marked(text: str, mark: str) -> Cell:
    return {"text": text, "mark": mark}


def terms(rows: Sequence[tuple[str, str]]) -> Block:
    """Terms with what they mean, in two columns of about the same length."""
    lengths = [len(name) + len(words) + _A_LINE for name, words in rows]
    split = min(range(len(rows) + 1), key=lambda i: abs(sum(lengths[:i]) - sum(lengths[i:])), default=0)
    return {"kind": "terms", "left": [list(row) for row in rows[:split]], "right": [list(row) for row in rows[split:]]}


def lines(height: float = 0.0) -> Block:
    """Ruled lines to write on."""
    return {"kind": "lines", "height": height}


def side_by_side(left: Sequence[Block], right: Sequence[Block], share: float = 0.5, *, high: bool = False) -> Block:
    """Two columns; ``high`` where both are as high as their part of the page."""
    return {"kind": "side", "blocks": [list(left), list(right)], "share": share, "high": high}


def sheet(parts: Sequence[tuple[float, Sequence[Block]]], gap: float = 3.5) -> Block:
    """A page of its own, filled by its parts: (share, blocks)."""
    return {"kind": "sheet", "rows": _rows(parts, gap)}


def rest_of_page(parts: Sequence[tuple[float, Sequence[Block]]], least: float, gap: float = 3.5) -> Block:
    """The rest of the last page, or one more where less than ``least`` millimetres are left."""
    return {"kind": "rest", "rows": _rows(parts, gap), "least": least}


def _rows(parts: Sequence[tuple[float, Sequence[Block]]], gap: float) -> Block:
    return {"kind": "rows", "gap": gap, "parts": [{"share": share, "blocks": list(b)} for share, b in parts]}
