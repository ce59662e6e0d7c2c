"""The parameter sets of a series."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from ...interface.parameters import (
    DateParameters,
    GridChangeParameters,
    GroundParameters,
    InputParameters,
    RegistrationParameters,
    SeriesParameters,
    ZoneParameters,
)


@dataclass(frozen=True)
class SeriesSettings:
    """All parameter groups of a series."""

    inputs: InputParameters = field(default_factory=InputParameters)
    dates: DateParameters = field(default_factory=DateParameters)
    ground: GroundParameters = field(default_factory=GroundParameters)
    registration: RegistrationParameters = field(default_factory=RegistrationParameters)
    change: GridChangeParameters = field(default_factory=GridChangeParameters)
    zones: ZoneParameters = field(default_factory=ZoneParameters)
    series: SeriesParameters = field(default_factory=SeriesParameters)

    def groups(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}
