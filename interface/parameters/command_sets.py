"""Which parameter sets each command takes, in the order of the workflow, in which dialogs and ``--help`` show them."""

from __future__ import annotations

from .batch import BatchParameters
from .change import ChangeParameters, GridChangeParameters
from .dates import DateParameters
from .dem_change import ModelParameters
from .displacement import DisplacementParameters, DisplacementStepParameters
from .distances import DistanceParameters
from .drawing import LabellingParameters, RegionParameters, TopViewParameters
from .ground import GroundParameters
from .inputs import InputParameters
from .maps import HeatmapParameters
from .outputs import OutputParameters
from .registration import RegistrationParameters
from .report import ReportParameters
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
_CHANGE: Sets = (ChangeParameters, ZoneParameters)
_SHOWN: Sets = (HeatmapParameters, ReportParameters, OutputParameters)

GROUND: Sets = (InputParameters, GroundParameters)
REGISTER: Sets = (InputParameters, SurfaceParameters, RegistrationParameters)
CHANGE: Sets = (*_READ, SurfaceParameters, *_CHANGE, *_SHOWN)
DEMCHANGE: Sets = (InputParameters, ModelParameters, ZoneParameters, *_SHOWN)
M3C2: Sets = (*_READ, SurfaceParameters, DistanceParameters)
"""``slopewatch m3c2`` also takes OutputParameters."""
DISPLACEMENT: Sets = (*_READ, SurfaceParameters, DisplacementParameters, OutputParameters)
SCREEN: Sets = (InputParameters, GroundParameters, ScreeningParameters)
INFO: Sets = (InputParameters,)
REPORT: Sets = (ReportParameters,)
TRAIN: Sets = (InputParameters, FineTuneParameters, OutputParameters)
TOPVIEW: Sets = (InputParameters, TopViewParameters, OutputParameters)
SUGGESTROI: Sets = (InputParameters, RegionParameters, OutputParameters)
EXPORTLABELSTUDIO: Sets = (LabellingParameters, OutputParameters)
IMPORTLABELSTUDIO: Sets = (OutputParameters,)
SIMULATE_SURVEY: Sets = (SurveyParameters, OutputParameters)
SIMULATE_SERIES: Sets = (CreepParameters, OutputParameters)
SIMULATE_SCENES: Sets = (ScenesParameters, OutputParameters)

_FROM_RAW: Sets = (GroundParameters, RegistrationParameters)
INSPECT: Sets = (*_READ, *_FROM_RAW, *_CHANGE, LastEpochParameters, *_SHOWN)
SERIES: Sets = (
    *_READ, SeriesParameters, *_FROM_RAW, GridChangeParameters, ZoneParameters, DisplacementStepParameters,
    OutputParameters,
)  # fmt: skip
BATCH: Sets = (
    BatchParameters, *_READ, SeriesParameters, *_FROM_RAW, *_CHANGE, DisplacementStepParameters, LastEpochParameters,
    *_SHOWN,
)  # fmt: skip
"""The batch's own, and all that ``inspect`` and ``series`` take."""
