"""An output folder of a small change, for reports to sign, and what is read of their pages."""

from __future__ import annotations

import ctypes
from pathlib import Path

import laspy
import numpy as np
import pypdfium2
import pypdfium2.raw as pdfium
from pyproj import CRS
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import ChangeParameters, DetailParameters
from slopewatch.workflows.change import change_step
from slopewatch.workflows.settings import Settings

WEST, SOUTH = 500_000.0, 3_500_000.0
_FRAME_SHARE = 0.075
"""Of a page's height: the running header above and the page number below."""
LEAST_FILLED, WIDEST_GAP = 0.45, 0.11
"""Of a page: squares of a centimetre with ink, with the letters' own gaps left out; a band of white between parts."""
_SCALE = 0.5
_SQUARE_MM, _MARGIN_SHARE = 10.0, 0.08


def cloud(path: Path, *, bowl: float, seed: int, points: int = 40_000) -> Path:
    """Ground of a slope of 20 x 20 m at 30 degrees, with a bowl and a bulge of 2.5 m radius."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 20, points), rng.uniform(0, 20, points)
    z = 50 + 0.58 * y + rng.normal(0, 0.01, points)
    for middle, sign in ((6, -1), (14, 1)):
        z += sign * bowl * np.clip(1 - ((x - middle) ** 2 + (y - 10) ** 2) / 6.25, 0, None)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [WEST, SOUTH, 0]
    header.add_crs(CRS(32651))
    las = laspy.LasData(header)
    las.x, las.y, las.z = WEST + x, SOUTH + y, z
    las.classification = np.full(points, 2)
    las.write(path)
    return path


def change_folder(clouds: Path, out: Path, details: DetailParameters | None = None, **more) -> Path:
    """The change of two such clouds, with a zone that sank and one that rose."""
    first, second = cloud(clouds / "first.laz", bowl=0.0, seed=1), cloud(clouds / "second.laz", bowl=0.3, seed=2)
    settings = Settings(
        change=ChangeParameters(cell=0.25, registration_error=0.002), details=details or DetailParameters()
    )
    days = ("2024-05-01", "2025-05-01")
    change_step(first, second, out, settings, dates=days, transform_path=None, progress=Progress(), **more)
    return out


class Pages:
    """A PDF as another program, PDFium, reads it."""

    def __init__(self, path: Path) -> None:
        with pypdfium2.PdfDocument(path) as document:
            self.fonts_embedded: dict[str, bool] = {}
            self.texts: list[str] = []
            self.lowest_ink: list[float] = []
            self.filled: list[float] = []
            self.widest_gap: list[float] = []
            for page in document:
                self.texts.append(" ".join(page.get_textpage().get_text_bounded().split()))
                body = _body(page)
                self.lowest_ink.append(_lowest_ink(body))
                self.filled.append(_filled(body))
                self.widest_gap.append(_widest_gap(body))
                self._note_fonts(page)
            self.outline = [(mark.get_title(), mark.get_dest().get_index()) for mark in document.get_toc()]
            self.links = sum(_links(page) for page in document)

    @property
    def text(self) -> str:
        return " ".join(self.texts)

    def _note_fonts(self, page: pypdfium2.PdfPage) -> None:
        for part in page.get_objects(filter=[pdfium.FPDF_PAGEOBJ_TEXT]):
            font = pdfium.FPDFTextObj_GetFont(part.raw)
            name = ctypes.create_string_buffer(200)
            pdfium.FPDFFont_GetBaseFontName(font, name, 200)
            self.fonts_embedded[name.value.decode()] = bool(pdfium.FPDFFont_GetIsEmbedded(font))


def _body(page: pypdfium2.PdfPage) -> np.ndarray:
    """Where ink is (rows, columns) between header and footer, half a millimetre or so a pixel."""
    image = np.asarray(page.render(scale=_SCALE).to_pil().convert("L"))
    frame = round(_FRAME_SHARE * len(image))
    return image[frame:-frame] < 235


def _lowest_ink(body: np.ndarray) -> float:
    """Where the lowest ink is, as a share of the body from above."""
    inked = np.flatnonzero(body.any(axis=1))
    return float(inked[-1] + 1) / len(body) if inked.size else 0.0


def _filled(body: np.ndarray) -> float:
    """Share of the squares of a centimetre between the margins that hold ink."""
    side = round(_SQUARE_MM / 25.4 * 72 * _SCALE)
    margin = round(_MARGIN_SHARE * body.shape[1])
    within = body[:, margin:-margin]
    rows, columns = (length // side for length in within.shape)
    squares = within[: rows * side, : columns * side].reshape(rows, side, columns, side)
    return float(squares.any(axis=(1, 3)).mean())


def _widest_gap(body: np.ndarray) -> float:
    """Height of the highest band without ink between what is above and below it, as a share of the body."""
    inked = np.flatnonzero(body.any(axis=1))
    return float(np.diff(inked).max(initial=1) - 1) / len(body)


def _links(page: pypdfium2.PdfPage) -> int:
    at, link, count = ctypes.c_int(0), pdfium.FPDF_LINK(), 0
    while pdfium.FPDFLink_Enumerate(page.raw, ctypes.byref(at), ctypes.byref(link)):
        count += 1
    return count
