"""Fonts made for a test, so that no test depends on those of the machine."""

from __future__ import annotations

from pathlib import Path

from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from slopewatch.interface.language import read_catalogue


def chinese_letters() -> str:
    """All letters beyond Latin of the Chinese catalogue."""
    catalogue = Path(__file__).resolve().parents[2] / "interface" / "language" / "zh_CN.po"
    whole = "".join(read_catalogue(catalogue).values())
    return "".join(sorted({letter for letter in whole if ord(letter) > 0x2FF}))


def font_file(path: Path, family: str, letters: str) -> Path:
    """A font whose glyphs are all the same box; it has no Latin letters."""
    pen = TTGlyphPen(None)
    pen.moveTo((100, 0))
    for corner in ((100, 800), (900, 800), (900, 0)):
        pen.lineTo(corner)
    pen.closePath()
    box = pen.glyph()
    names = [".notdef", *(f"u{ord(letter):04X}" for letter in letters)]
    builder = FontBuilder(1000, isTTF=True)
    builder.setupGlyphOrder(names)
    builder.setupCharacterMap({ord(letter): name for letter, name in zip(letters, names[1:], strict=True)})
    builder.setupGlyf(dict.fromkeys(names, box))
    builder.setupHorizontalMetrics(dict.fromkeys(names, (1000, 100)))
    builder.setupHorizontalHeader(ascent=880, descent=-120)
    builder.setupNameTable({"familyName": family, "styleName": "Regular"})
    builder.setupOS2()
    builder.setupPost()
    builder.save(path)
    return path
