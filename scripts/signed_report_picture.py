#!/usr/bin/env -S .venv/bin/python
"""docs/images/signed_report.png: pages of a report to sign next to one another.

``scripts/signed_report_picture.py FOLDER/report.pdf`` takes its first three pages; a second argument is the name of
another picture, such as corridor_report.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import pypdfium2
from PIL import Image
from slopewatch.scripts.screenshots import shrink

PICTURES = Path(__file__).resolve().parents[1] / "docs" / "images"
_PAGES, _SCALE, _GAP = 3, 1.0, 10


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
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "pages.png"
        picture.save(whole)
        shrink(whole, PICTURES / f"{name}.png")  # which keeps the colours of keys and lines


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:3])
