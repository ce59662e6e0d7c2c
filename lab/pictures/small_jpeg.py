"""A JPEG of at most a number of bytes, for pictures of shaded relief, of which PNG makes too much."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

WIDTH, BYTES = 1000, 295_000
_QUALITIES = range(80, 20, -2)


def keep_small(picture: Image.Image, path: Path) -> None:
    """Write a picture ``WIDTH`` pixels wide, in the best quality that has at most ``BYTES``.

    Raises:
        ValueError: no quality has so few.
    """
    small = picture.convert("RGB")
    small = small.resize((WIDTH, round(small.height * WIDTH / small.width)), Image.Resampling.LANCZOS)
    for quality in _QUALITIES:
        small.save(path, quality=quality, optimize=True)
        if path.stat().st_size <= BYTES:
            return
    raise ValueError(f"{path} cannot be as small as {BYTES} bytes; draw less of it.")
