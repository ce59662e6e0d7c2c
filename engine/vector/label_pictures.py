"""The task file that goes with pictures for labelling: where each lies, and which segments were shown on it."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from pyproj import CRS
from pyproj.exceptions import CRSError
from rasterio.errors import NotGeoreferencedWarning, RasterioError

from ...interface.input_files import LABELS, PICTURE
from ..core.arrays import Bool
from ..core.errors import InputError
from ..core.input_files import read_input
from ..core.json_shapes import anything, fields, number, read_json, rows, table, text
from ..core.messages import shown
from ..grid.grid import Grid

PLACE = "slopewatch"
"""Field of a task's data that holds where its picture lies."""
_WHOLE = number(1, 1e6, whole=True)
_TASKS = rows(
    fields(
        {
            "data": fields(
                {
                    PLACE: fields(
                        {
                            "picture": text(),
                            "sha256": text("[0-9a-f]{64}", "a checksum"),
                            "width": _WHOLE,
                            "height": _WHOLE,
                            "west": number(),
                            "north": number(),
                            "pixel_m": number(0.0, above=True),
                            "crs": text(),
                            "segments": table(fields({"segment": text(), "attributes": table(anything)})),
                        }
                    )
                }
            )
        }
    ),
    1,
)
_SENTENCE = (
    "The tasks {path} cannot be read ({why}); give the tasks.json that slopewatch exportlabelstudio wrote next to the "
    "pictures."
)


@dataclass(frozen=True)
class LabelPicture:
    """A picture: file name, where its pixels lie, and the segments by the id of their region.

    ``segments`` holds ``segment`` (what the region is a part of) and ``attributes`` of each region that was shown.
    """

    name: str
    grid: Grid
    crs: CRS | None
    sha256: str
    folder: Path
    segments: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def facts(self) -> dict[str, Any]:
        """As the task file holds them."""
        return {
            "picture": self.name,
            "sha256": self.sha256,
            "width": self.grid.columns,
            "height": self.grid.rows,
            "west": self.grid.west,
            "north": self.grid.north,
            "pixel_m": self.grid.cell,
            "crs": "" if self.crs is None else self.crs.to_wkt(),
            "segments": dict(self.segments),
        }

    def measured(self) -> Bool:
        """Pixels (rows, columns) in which something was measured: those that are not transparent.

        Raises:
            InputError: the picture is not there, or is another one.
        """
        path = self.folder / self.name
        if not path.is_file():
            raise InputError(f"The picture {shown(path)} is not next to its tasks; put it there.")
        if hashlib.sha256(read_input(path, PICTURE)).hexdigest() != self.sha256:
            raise InputError(
                f"The picture {shown(path)} is not the one that its tasks were written for; export it again."
            )
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", NotGeoreferencedWarning)  # the tasks say where it lies
                with rasterio.open(path, driver="PNG") as source:
                    return np.asarray(source.read(4) > 0)
        except (RasterioError, IndexError) as error:
            raise InputError(f"The picture {shown(path)} cannot be read; export it again.") from error


def read_pictures(path: Path) -> dict[str, LabelPicture]:
    """The pictures of a task file by name.

    Raises:
        InputError: there is no such file, or it is none of ``slopewatch exportlabelstudio``.
    """
    try:
        document = read_json(path, _TASKS, _SENTENCE, LABELS)
    except FileNotFoundError:
        raise InputError(f"The tasks {shown(path)} do not exist; check their path.") from None
    found: dict[str, LabelPicture] = {}
    for task in document:
        facts = task["data"][PLACE]
        try:
            crs = CRS.from_wkt(facts["crs"]) if facts["crs"] else None
        except CRSError as error:
            raise InputError(_SENTENCE.format(path=shown(path), why="its reference system is unknown")) from error
        grid = Grid(facts["west"], facts["north"], facts["pixel_m"], facts["height"], facts["width"])
        name = Path(facts["picture"]).name
        found[name] = LabelPicture(name, grid, crs, facts["sha256"], Path(path).parent, facts["segments"])
    return found
