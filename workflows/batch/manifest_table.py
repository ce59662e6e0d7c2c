"""A manifest as a table: its rows as texts by column, whatever file it was."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pyproj import CRS
    from shapely.geometry.base import BaseGeometry


@dataclass(frozen=True)
class Row:
    """``place`` names the row in messages; ``values`` are stripped texts by column in small letters.

    ``polygon`` is the slope's region in ``crs`` where the manifest is a layer, ``path`` the cloud where its name
    need not be text. ``problem`` says what is wrong with it already.
    """

    place: str
    values: Mapping[str, str]
    polygon: BaseGeometry | None = None
    crs: CRS | None = None
    path: Path | None = None
    problem: str = ""


@dataclass(frozen=True)
class Table:
    """``folder`` is where relative paths start.

    ``write_region`` writes the polygons of a slope's rows into a folder, where the manifest is a layer.
    """

    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    folder: Path
    write_region: Callable[[Path, str, Sequence[Row]], Path | None] | None = None
