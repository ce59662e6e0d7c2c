"""The vector files that results are related to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class LayerFiles:
    """Vector files that a command may be given.

    Attributes:
        centreline: the road's axis, along which zones are placed.
        field_names: JSON or CSV with an agency's names of our fields.
        classes: polygons of the classes of asset.
    """

    centreline: Path | None = None
    field_names: Path | None = None
    classes: Path | None = None

    @property
    def inputs(self) -> list[tuple[str, Path | None]]:
        """Role and path of each, for the record."""
        given = {"centreline": self.centreline, "field_names": self.field_names, "classes": self.classes}
        return list(given.items())


NO_LAYERS = LayerFiles()
"""None of them."""
