"""The vector files that results are related to."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path


@dataclass(frozen=True)
class LayerFiles:
    """Vector files that a command may be given.

    Attributes:
        centreline: the road's axis, along which zones are placed.
        field_names: JSON or CSV with an agency's names of our fields.
        classes: polygons of the classes of asset.
        corrections: polygons that exclude areas, or force or forbid ground there.
    """

    centreline: Path | None = None
    field_names: Path | None = None
    classes: Path | None = None
    corrections: Path | None = None

    @property
    def inputs(self) -> list[tuple[str, Path | None]]:
        """Role and path of each, for the record."""
        return [(field.name, getattr(self, field.name)) for field in fields(self)]


NO_LAYERS = LayerFiles()
"""None of them."""
