"""Which parameter sets each command takes, in the order in which the dialogs and ``--help`` show them."""

from __future__ import annotations

from .batch import BatchParameters
from .change import ChangeParameters, GridChangeParameters
from .dates import DateParameters
from .distances import DistanceParameters
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

GROUND: Sets = (GroundParameters, InputParameters)
REGISTER: Sets = (SurfaceParameters, RegistrationParameters, InputParameters)
M3C2: Sets = (SurfaceParameters, DistanceParameters, InputParameters, DateParameters)
"""``slopewatch m3c2`` also takes OutputParameters."""
SCREEN: Sets = (ScreeningParameters, GroundParameters, InputParameters)
REPORT: Sets = (ReportParameters,)
TRAIN: Sets = (FineTuneParameters, InputParameters, OutputParameters)
SIMULATE_SURVEY: Sets = (SurveyParameters, OutputParameters)
SIMULATE_SERIES: Sets = (CreepParameters, OutputParameters)
SIMULATE_SCENES: Sets = (ScenesParameters, OutputParameters)

_CHANGE: Sets = (ChangeParameters, ZoneParameters, HeatmapParameters, ReportParameters)
_FOLDER: Sets = (InputParameters, DateParameters, OutputParameters)
CHANGE: Sets = (SurfaceParameters, *_CHANGE, *_FOLDER)
INSPECT: Sets = (GroundParameters, RegistrationParameters, *_CHANGE, LastEpochParameters, *_FOLDER)
SERIES: Sets = (
    SeriesParameters, GroundParameters, RegistrationParameters, GridChangeParameters, ZoneParameters, *_FOLDER,
)  # fmt: skip
BATCH: Sets = (
    BatchParameters, SeriesParameters, GroundParameters, RegistrationParameters, *_CHANGE, LastEpochParameters,
    *_FOLDER,
)  # fmt: skip
"""The batch's own, and all that ``inspect`` and ``series`` take."""
