"""Which parameter sets each command takes, in the order of the workflow, in which dialogs and ``--help`` show them."""

from __future__ import annotations

from .assets import AssetParameters
from .batch import BatchParameters
from .change import ChangeParameters
from .dates import DateParameters
from .dem_change import ModelParameters
from .details import DetailParameters
from .displacement import DisplacementParameters, DisplacementStepParameters, MotionMemoryParameters
from .distances import DistanceParameters
from .drawing import LabellingParameters, RegionParameters, TopViewParameters
from .flight import FlightParameters
from .ground import GroundParameters, RawGroundParameters
from .handover import HandoverParameters
from .inputs import InputParameters
from .maps import HeatmapParameters
from .mission import MissionParameters
from .movement import MovementParameters
from .outputs import OutputParameters
from .project import ProjectParameters
from .registration import RegistrationParameters
from .report import ReportParameters
from .road import RoadParameters
from .screening import LastEpochParameters, ScreeningParameters
from .series import SeriesParameters
from .simulation import CreepParameters, ScenesParameters, SurveyParameters
from .specification import ParameterSet
from .surface import SurfaceParameters
from .training import FineTuneParameters
from .zones import ZoneParameters

Sets = tuple[type[ParameterSet], ...]

_READ: Sets = (InputParameters, DateParameters)
"""How clouds and their days are read: the first of the headings, as the flow begins there."""
_CHANGE: Sets = (ChangeParameters, ZoneParameters, MovementParameters)
_RELATED: Sets = (RoadParameters, AssetParameters)
"""What zones and change are related to: the road that they lie on, and classes of asset."""
_SHOWN: Sets = (HeatmapParameters, ReportParameters, DetailParameters, OutputParameters)

GROUND: Sets = (InputParameters, GroundParameters)
REGISTER: Sets = (InputParameters, SurfaceParameters, RegistrationParameters)
CHANGE: Sets = (*_READ, SurfaceParameters, *_CHANGE, *_RELATED, *_SHOWN)
DEMCHANGE: Sets = (InputParameters, ModelParameters, ZoneParameters, *_RELATED, *_SHOWN)
M3C2: Sets = (*_READ, SurfaceParameters, DistanceParameters, ZoneParameters, DetailParameters)
"""``slopewatch m3c2`` also takes OutputParameters."""
DISPLACEMENT: Sets = (
    *_READ, SurfaceParameters, DisplacementParameters, MotionMemoryParameters, RoadParameters, OutputParameters
)  # fmt: skip
SCREEN: Sets = (InputParameters, GroundParameters, ScreeningParameters, RoadParameters)
LOCATE: Sets = (RoadParameters, OutputParameters)
INFO: Sets = (InputParameters,)
REPORT: Sets = (ReportParameters, DetailParameters)
EXPORTGIS: Sets = (HandoverParameters, OutputParameters)
CREATEPROJECT: Sets = (ProjectParameters, OutputParameters)
TRAIN: Sets = (InputParameters, FineTuneParameters, OutputParameters)
TOPVIEW: Sets = (InputParameters, TopViewParameters, OutputParameters)
PLANFLIGHT: Sets = (InputParameters, FlightParameters, MissionParameters, OutputParameters)
COMPAREFLIGHT: Sets = (InputParameters, OutputParameters)
SUGGESTROI: Sets = (InputParameters, RegionParameters, OutputParameters)
EXPORTLABELSTUDIO: Sets = (LabellingParameters, OutputParameters)
IMPORTLABELSTUDIO: Sets = (OutputParameters,)
SIMULATE_SURVEY: Sets = (SurveyParameters, OutputParameters)
SIMULATE_SERIES: Sets = (CreepParameters, OutputParameters)
SIMULATE_SCENES: Sets = (ScenesParameters, OutputParameters)

_FROM_RAW: Sets = (RawGroundParameters, RegistrationParameters)
_MOTION: Sets = (DisplacementStepParameters, DisplacementParameters)
INSPECT: Sets = (*_READ, *_FROM_RAW, *_CHANGE, *_MOTION, LastEpochParameters, *_RELATED, *_SHOWN)
SERIES: Sets = (
    *_READ, SeriesParameters, *_FROM_RAW, ChangeParameters, ZoneParameters, DisplacementStepParameters, *_RELATED,
    DetailParameters, OutputParameters,
)  # fmt: skip
BATCH: Sets = (
    BatchParameters, *_READ, SeriesParameters, *_FROM_RAW, *_CHANGE, *_MOTION, LastEpochParameters, *_RELATED, *_SHOWN,
)  # fmt: skip
"""The batch's own, and all that ``inspect`` and ``series`` take."""
