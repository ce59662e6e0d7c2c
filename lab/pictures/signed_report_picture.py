#!/usr/bin/env -S .venv/bin/python
"""docs/images/signed_report.png: pages of a report to sign next to one another.

``lab/pictures/signed_report_picture.py FOLDER/report.pdf`` takes its first three pages; a second argument names
another picture, such as corridor_report.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pypdfium2
from PIL import Image
from slopewatch.engine.maps.palette import diverging_colours

PICTURES = Path(__file__).resolve().parents[2] / "docs" / "images"
_PAGES, _SCALE, _GAP = 3, 1.0, 10
_FREQUENT, _OF_SCALE = 96, 61


def main(pdf: Path, name: str = "signed_report") -> None:
    """Draw the pages of ``pdf`` as the picture ``name``."""
    with pypdfium2.PdfDocument(pdf) as document:
        pages = [document[number].render(scale=_SCALE).to_pil().convert("RGB") for number in range(_PAGES)]
    width = sum(page.width for page in pages) + _GAP * (len(pages) + 1)
    picture = Image.new("RGB", (width, pages[0].height + 2 * _GAP), "#9aa0a6")
    left = _GAP
    for page in pages:
        picture.paste(page, (left, _GAP))
        left += page.width + _GAP
    picture.quantize(palette=_palette(picture), dither=Image.Dither.NONE).save(PICTURES / f"{name}.png", optimize=True)


def _palette(picture: Image.Image) -> Image.Image:
    """256 colours: the most frequent ones, the scale of the change, and those that reach farthest.

    The usual median cut loses what few pixels have: the colours of keys, lines and the ends of scales.
    """
    colours, counts = np.unique(np.asarray(picture).reshape(-1, 3), axis=0, return_counts=True)
    frequent = colours[np.argsort(-counts, kind="stable")][:_FREQUENT]
    scale = diverging_colours(np.linspace(-1.0, 1.0, _OF_SCALE), 1.0)
    count = 256 - _FREQUENT - _OF_SCALE
    rest = picture.quantize(count, Image.Quantize.MAXCOVERAGE).getpalette() or []
    found = Image.new("P", (1, 1))
    found.putpalette([*frequent.ravel().tolist(), *scale.ravel().tolist(), *rest[: 3 * count]])
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:3])
