"""The version of SlopeWatch, which metadata.txt holds: QGIS reads it there."""

from __future__ import annotations

import configparser
from pathlib import Path


def _read() -> str:
    metadata = configparser.ConfigParser(interpolation=None)
    metadata.read(Path(__file__).resolve().parents[2] / "metadata.txt", encoding="utf-8")
    return metadata["general"]["version"]


VERSION = _read()
