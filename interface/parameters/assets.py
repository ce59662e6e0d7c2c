"""Parameters of classes of asset."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter


@dataclass(frozen=True)
class AssetParameters(ParameterSet, record_name="assets", title="Assets"):
    """Change by class of asset."""

    class_field: str = _parameter(
        "class",
        "Field of the classes",
        "Field of the classes' polygons that names the class of each, such as bench, drain, berm, retaining wall or "
        "pavement.",
        advanced=True,
    )
