"""Pictures inside of a report: a file's bytes as a data URI, with the text for those who cannot see it."""

from __future__ import annotations

import base64
import io
import struct
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure
from PIL import Image, ImageOps

from ...interface.input_files import PHOTO, PICTURE
from ..core.errors import InputError
from ..core.input_files import open_input
from ..maps.map_parts import PNG_OPTIONS

_DPI = 160
_CSS_DPI = 96
_INCH_MM = 25.4
_MAX_PIXELS = 100_000_000
"""Of a picture: some ten times what a run draws, and as many as the cameras of telephones give."""
_PHOTO_PIXELS, _PHOTO_QUALITY = 900, 80
"""The longest side of a photo in the report, which then takes some 100 kB."""
_PHOTO_WIDTH, _PHOTO_HEIGHT = 320, 260
"""CSS pixels that a photo is shown in, at most."""
_DAMAGED = (
    OSError, ValueError, SyntaxError, TypeError, KeyError, IndexError, ArithmeticError, EOFError, MemoryError,
    Image.DecompressionBombError, struct.error, zlib.error,
)  # fmt: skip
"""What Pillow raises of damaged pictures and of what they say of themselves."""
# no clock and no random ids in a picture, else its bytes differ each time
_SVG: dict[Any, Any] = {
    "svg.hashsalt": "slopewatch",
    "svg.fonttype": "path",
    "path.simplify": True,
    "path.simplify_threshold": 0.2,
}


@dataclass(frozen=True)
class Picture:
    """``source`` is a data URI, ``text`` says what is to be seen; ``width`` and ``height`` in CSS pixels."""

    source: str
    text: str
    width: int
    height: int


def drawing(figure: Figure, text: str) -> Picture:
    """A chart as SVG, which prints sharply at any size."""
    stream = io.BytesIO()
    with matplotlib.rc_context(_SVG):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": "SlopeWatch"})
    width, height = figure.get_size_inches() * _CSS_DPI
    return Picture(_uri("image/svg+xml", stream.getvalue()), text, round(width), round(height))


def map_picture(figure: Figure, text: str) -> Picture:
    """A map as PNG."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=_DPI, metadata={"Software": "SlopeWatch"}, pil_kwargs=PNG_OPTIONS)
    width, height = figure.get_size_inches() * _CSS_DPI
    return Picture(_uri("image/png", stream.getvalue()), text, round(width), round(height))


def encoded(content: bytes, text: str, size_mm: tuple[float, float]) -> Picture:
    """A picture that is drawn already, as PNG or SVG; ``size_mm`` are its width and height."""
    kind = "image/png" if content.startswith(b"\x89PNG") else "image/svg+xml"
    width, height = (max(1, round(mm / _INCH_MM * _CSS_DPI)) for mm in size_mm)
    return Picture(_uri(kind, content), text, width, height)


def photograph(path: Path, text: str, width: int, *, quality: int = 88) -> Picture | None:
    """A picture file as JPEG, because views of plants and rocks are several times larger as PNG; None without it.

    Raises:
        InputError: it is no PNG that can be read.
    """
    if not path.is_file():
        return None
    try:
        with open_input(path, PICTURE) as stream, Image.open(stream, formats=["PNG"]) as source:
            if source.width * source.height > _MAX_PIXELS:
                raise ValueError("too large")
            image = Image.new("RGB", source.size, "white")
            rgba = source.convert("RGBA")
            image.paste(rgba, mask=rgba.getchannel("A"))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError, struct.error, zlib.error) as error:
        raise InputError(f"{path} cannot be read as a picture; make the run again.") from error
    stream = io.BytesIO()
    image.save(stream, "JPEG", quality=quality, subsampling=0)
    return Picture(_uri("image/jpeg", stream.getvalue()), text, width, round(width * image.height / image.width))


def photo(path: Path, text: str) -> Picture:
    """Somebody's photo, upright and scaled down; nothing but its pixels is taken from the file.

    Raises:
        ValueError: it is no picture that can be read, or has too many pixels.
        OSError: the file cannot be read.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of odd tags, and of many pixels, which are limited here
            with (
                open_input(path, PHOTO) as stream,
                Image.open(stream, formats=["JPEG", "PNG", "TIFF", "WEBP"]) as source,
            ):
                if source.width * source.height > _MAX_PIXELS:
                    raise ValueError("too large")
                source.draft("RGB", (2 * _PHOTO_PIXELS, 2 * _PHOTO_PIXELS))
                source.thumbnail((_PHOTO_PIXELS, _PHOTO_PIXELS))
                rgba = ImageOps.exif_transpose(source).convert("RGBA")
        image = Image.new("RGB", rgba.size, "white")
        image.paste(rgba, mask=rgba.getchannel("A"))
    except (InputError, *_DAMAGED) as error:
        raise ValueError(f"{path.name} cannot be read as a picture") from error
    stream = io.BytesIO()
    image.save(stream, "JPEG", quality=_PHOTO_QUALITY)
    scale = min(_PHOTO_WIDTH / image.width, _PHOTO_HEIGHT / image.height)
    size = max(1, round(scale * image.width)), max(1, round(scale * image.height))
    return Picture(_uri("image/jpeg", stream.getvalue()), text, *size)


def _uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
