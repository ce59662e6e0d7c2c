"""The parameter sets that each command takes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ..interface.parameters import (
    ChangeParameters,
    DateParameters,
    DistanceParameters,
    GroundParameters,
    HeatmapParameters,
    InputParameters,
    LastEpochParameters,
    RegistrationParameters,
    ReportParameters,
    ScreeningParameters,
    SurfaceParameters,
    ZoneParameters,
)


@dataclass(frozen=True)
class Settings:
    """All parameter groups of the flow; ``surface`` is for the single steps that take clouds as they are."""

    inputs: InputParameters = field(default_factory=InputParameters)
    dates: DateParameters = field(default_factory=DateParameters)
    surface: SurfaceParameters = field(default_factory=SurfaceParameters)
    ground: GroundParameters = field(default_factory=GroundParameters)
    registration: RegistrationParameters = field(default_factory=RegistrationParameters)
    change: ChangeParameters = field(default_factory=ChangeParameters)
    zones: ZoneParameters = field(default_factory=ZoneParameters)
    heatmap: HeatmapParameters = field(default_factory=HeatmapParameters)
    screening: LastEpochParameters = field(default_factory=LastEpochParameters)
    report: ReportParameters = field(default_factory=ReportParameters)

    def groups(self) -> dict[str, Any]:
        return {
            "inputs": self.inputs,
            "dates": self.dates,
            "ground": self.ground,
            "registration": self.registration,
            "change": self.change,
            "zones": self.zones,
            "heatmap": self.heatmap,
            "screening": self.screening,
            "report": self.report,
        }


@dataclass(frozen=True)
class ScreeningSettings:
    """The parameter groups of screening; ``ground`` counts where the ground is extracted first."""

    inputs: InputParameters
    ground: GroundParameters
    screening: ScreeningParameters


@dataclass(frozen=True)
class DistanceSettings:
    """The parameter groups of this command."""

    inputs: InputParameters
    distances: DistanceParameters
    dates: DateParameters = field(default_factory=DateParameters)
    surface: SurfaceParameters = field(default_factory=SurfaceParameters)
