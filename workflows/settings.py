"""The parameter sets that each command takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import Field, dataclass, field, fields
from typing import Any, TypeVar

from ..interface.parameters import (
    AssetParameters,
    ChangeParameters,
    DateParameters,
    DetailParameters,
    DisplacementParameters,
    DisplacementStepParameters,
    DistanceParameters,
    GridChangeParameters,
    GroundParameters,
    HeatmapParameters,
    InputParameters,
    LastEpochParameters,
    ModelParameters,
    MotionMemoryParameters,
    MovementParameters,
    ParameterSet,
    RawGroundParameters,
    RegistrationParameters,
    ReportParameters,
    RoadParameters,
    ScreeningParameters,
    SeriesParameters,
    SurfaceParameters,
    ZoneParameters,
)


@dataclass(frozen=True)
class Settings:
    """All parameter groups of the flow; ``surface`` is for the single steps that take clouds as they are."""

    inputs: InputParameters = field(default_factory=InputParameters)
    dates: DateParameters = field(default_factory=DateParameters)
    surface: SurfaceParameters = field(default_factory=SurfaceParameters)
    ground: RawGroundParameters = field(default_factory=RawGroundParameters)
    registration: RegistrationParameters = field(default_factory=RegistrationParameters)
    change: ChangeParameters = field(default_factory=ChangeParameters)
    zones: ZoneParameters = field(default_factory=ZoneParameters)
    road: RoadParameters = field(default_factory=RoadParameters)
    assets: AssetParameters = field(default_factory=AssetParameters)
    displacement_step: DisplacementStepParameters = field(default_factory=DisplacementStepParameters)
    displacement: DisplacementParameters = field(default_factory=DisplacementParameters)
    movement: MovementParameters = field(default_factory=MovementParameters)
    heatmap: HeatmapParameters = field(default_factory=HeatmapParameters)
    screening: LastEpochParameters = field(default_factory=LastEpochParameters)
    report: ReportParameters = field(default_factory=ReportParameters)
    details: DetailParameters = field(default_factory=DetailParameters)


@dataclass(frozen=True)
class ScreeningSettings:
    """The parameter groups of screening; ``ground`` counts where the ground is extracted first."""

    inputs: InputParameters = field(default_factory=InputParameters)
    ground: GroundParameters = field(default_factory=GroundParameters)
    screening: ScreeningParameters = field(default_factory=ScreeningParameters)
    road: RoadParameters = field(default_factory=RoadParameters)


@dataclass(frozen=True)
class DistanceSettings:
    """The parameter groups of M3C2."""

    inputs: InputParameters = field(default_factory=InputParameters)
    distances: DistanceParameters = field(default_factory=DistanceParameters)
    dates: DateParameters = field(default_factory=DateParameters)
    surface: SurfaceParameters = field(default_factory=SurfaceParameters)
    zones: ZoneParameters = field(default_factory=ZoneParameters)
    details: DetailParameters = field(default_factory=DetailParameters)


@dataclass(frozen=True)
class DisplacementSettings:
    """The parameter groups of motion along the surface."""

    inputs: InputParameters = field(default_factory=InputParameters)
    displacement: DisplacementParameters = field(default_factory=DisplacementParameters)
    motion_memory: MotionMemoryParameters = field(default_factory=MotionMemoryParameters)
    road: RoadParameters = field(default_factory=RoadParameters)
    dates: DateParameters = field(default_factory=DateParameters)
    surface: SurfaceParameters = field(default_factory=SurfaceParameters)


@dataclass(frozen=True)
class SeriesSettings:
    """The parameter groups of a series."""

    inputs: InputParameters = field(default_factory=InputParameters)
    dates: DateParameters = field(default_factory=DateParameters)
    ground: RawGroundParameters = field(default_factory=RawGroundParameters)
    registration: RegistrationParameters = field(default_factory=RegistrationParameters)
    change: GridChangeParameters = field(default_factory=ChangeParameters)
    zones: ZoneParameters = field(default_factory=ZoneParameters)
    series: SeriesParameters = field(default_factory=SeriesParameters)
    details: DetailParameters = field(default_factory=DetailParameters)
    road: RoadParameters = field(default_factory=RoadParameters)
    assets: AssetParameters = field(default_factory=AssetParameters)
    displacement_step: DisplacementStepParameters = field(default_factory=DisplacementStepParameters)


@dataclass(frozen=True)
class ModelSettings:
    """The parameter groups of a change between elevation models."""

    inputs: InputParameters = field(default_factory=InputParameters)
    elevation_models: ModelParameters = field(default_factory=ModelParameters)
    zones: ZoneParameters = field(default_factory=ZoneParameters)
    road: RoadParameters = field(default_factory=RoadParameters)
    assets: AssetParameters = field(default_factory=AssetParameters)
    heatmap: HeatmapParameters = field(default_factory=HeatmapParameters)
    report: ReportParameters = field(default_factory=ReportParameters)
    details: DetailParameters = field(default_factory=DetailParameters)


Bundle = TypeVar(
    "Bundle", Settings, ScreeningSettings, DistanceSettings, DisplacementSettings, SeriesSettings, ModelSettings
)


def gathered(bundle: type[Bundle], group_of: Callable[[type[Any]], Any]) -> Bundle:
    """A bundle with each of its groups as ``group_of`` gives it for the group's class."""
    return bundle(**{f.name: group_of(_class_of(f)) for f in fields(bundle)})


def _class_of(group: Field[Any]) -> type[Any]:
    made_by = group.default_factory
    if not isinstance(made_by, type):
        raise TypeError(f"{group.name} has no class of parameters as its default_factory")
    return made_by


def groups(
    bundle: Settings | ScreeningSettings | DistanceSettings | DisplacementSettings | SeriesSettings | ModelSettings,
    *names: str,
) -> dict[str, ParameterSet]:
    """Those groups of a bundle by name, as a run record takes them."""
    return {name: getattr(bundle, name) for name in names}
