#!/usr/bin/env -S .venv/bin/python
"""docs/images/report.png: four pages of the report of a simulated slope, as a browser prints them.

``lab/pictures/report_picture.py [FOLDER]`` simulates two surveys and inspects the slope in FOLDER (a temporary one by
default), prints the report with Chromium and draws the pages with the GDAL of the system's Python, which reads PDF
where it was built with Poppler: ``apt install chromium python3-gdal``.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
PICTURE = ROOT / "docs" / "images" / "report.png"
SURVEYS = ("2024-05-01", "2025-05-01")
SHOWN = ("summary", "limits", "maps", "volumes", "zones", "profiles")
"""Sections of the report; the others have pages of their own, which are left out."""
PAGES, POINTS, DPI = 4, 400_000, 110
WIDTH, GAP = 1270, 10
COLOURS = 256
_RASTERISE = """
import sys
from osgeo import gdal
gdal.UseExceptions()
gdal.SetConfigOption("GDAL_PDF_DPI", sys.argv[3])
for page in range(1, int(sys.argv[4]) + 1):
    gdal.Translate(f"{sys.argv[2]}/page{page}.png", f"PDF:{page}:{sys.argv[1]}", format="PNG", bandList=[1, 2, 3])
"""


def run(*command: str | Path, folder: Path | None = None) -> None:
    subprocess.run([str(part) for part in command], check=True, stdin=subprocess.DEVNULL, cwd=folder)


def inspected(folder: Path) -> Path:
    """The report of the inspection of two simulated surveys."""
    engine = (sys.executable, "-m", "slopewatch.cli")
    # in the folder, because the report names the files as they were given
    run(*engine, "simulate", "survey", "--output-dir", "survey", "--points", str(POINTS), folder=folder)
    epochs = [part for day in SURVEYS for part in ("--epoch", f"{day}=survey/{day}.laz")]
    given = (*epochs, "--roi", "survey/roi.gpkg", "--output-dir", "results", "--language", "en")
    run(*engine, "inspect", *given, folder=folder)
    return folder / "results" / "report.html"


def printed(report: Path, folder: Path) -> list[Image.Image]:
    """The pages of the sections that are shown."""
    browser = next((found for name in ("chromium", "google-chrome", "chrome") if (found := shutil.which(name))), None)
    if browser is None:
        raise SystemExit("No Chromium is installed, which prints the report: apt install chromium.")
    page = report.read_text(encoding="utf-8")
    sections = set(re.findall(r'<section[^>]*aria-labelledby="([^"]+)"', page)) - {*SHOWN, "warnings"}
    hidden = ", ".join(f'section[aria-labelledby="{name}"]' for name in sorted(sections))
    short = folder / "short.html"
    short.write_text(page.replace("</style>", f"{hidden}, footer {{ display: none }}</style>", 1), encoding="utf-8")
    pdf = folder / "short.pdf"
    run(browser, "--headless", "--no-sandbox", "--no-pdf-header-footer", f"--print-to-pdf={pdf}", short.as_uri())
    run("/usr/bin/python3", "-c", _RASTERISE, pdf, folder, str(DPI), str(PAGES))
    return [Image.open(folder / f"page{number}.png").convert("RGB") for number in range(1, PAGES + 1)]


def sheet(pages: list[Image.Image]) -> Image.Image:
    """Two pages in a row, in few colours, which takes a third of the bytes."""
    width = (WIDTH - 3 * GAP) // 2
    height = round(width * pages[0].height / pages[0].width)
    made = Image.new("RGB", (WIDTH, 2 * height + 3 * GAP), "#b9bec6")
    for number, page in enumerate(pages):
        place = (GAP + number % 2 * (width + GAP), GAP + number // 2 * (height + GAP))
        made.paste(page.resize((width, height), Image.Resampling.LANCZOS), place)
    return made.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)


def main() -> None:
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(sys.argv[1] if len(sys.argv) > 1 else temporary).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        report = inspected(folder)
        sheet(printed(report, folder)).save(PICTURE, optimize=True)


if __name__ == "__main__":
    main()
