"""Every parameter of SlopeWatch: name, default, unit, bounds and help, in one place.

The QGIS dialogs, the command line and the batch manifest are built from these dataclasses, so they cannot
disagree. Standard library only and Python 3.9's language, because QGIS's interpreter imports this module.

Defaults are chosen by measurement (see docs/figures.md); ``PROFILES["paper"]`` reproduces the published settings of
ground extraction, registration and gridding.
"""

from __future__ import annotations

from . import command_sets
from .assets import AssetParameters
from .batch import BatchParameters
from .change import ChangeParameters, GridChangeParameters
from .dates import DateParameters
from .dem_change import ModelParameters
from .details import DetailParameters
from .displacement import DisplacementParameters, DisplacementStepParameters, MotionMemoryParameters
from .distances import DistanceParameters
from .drawing import LabellingParameters, RegionParameters, TopViewParameters
from .flight import FlightParameters
from .ground import GroundParameters, RawGroundParameters
from .handover import HANDOVER_FORMATS, HandoverParameters
from .inputs import InputParameters
from .maps import HeatmapParameters
from .mission import MissionParameters
from .movement import MovementParameters
from .outputs import OutputParameters
from .profiles import PROFILES, PUBLISHED_WORKFLOW, PUBLISHED_WORKFLOW_ID
from .project import PAPERS, ProjectParameters
from .registration import RegistrationParameters
from .report import ReportParameters
from .road import RoadParameters
from .screening import LastEpochParameters, ScreeningParameters
from .series import SeriesParameters
from .simulation import CreepParameters, ScenesParameters, SurveyParameters
from .specification import AUTO, ParameterError, ParameterSet, Specification, given, profile_values
from .surface import SurfaceParameters
from .training import FineTuneParameters
from .zones import ZoneParameters

__all__ = [
    "AUTO",
    "HANDOVER_FORMATS",
    "PAPERS",
    "PROFILES",
    "PUBLISHED_WORKFLOW",
    "PUBLISHED_WORKFLOW_ID",
    "AssetParameters",
    "BatchParameters",
    "ChangeParameters",
    "CreepParameters",
    "DateParameters",
    "DetailParameters",
    "DisplacementParameters",
    "DisplacementStepParameters",
    "DistanceParameters",
    "FineTuneParameters",
    "FlightParameters",
    "GridChangeParameters",
    "GroundParameters",
    "HandoverParameters",
    "HeatmapParameters",
    "InputParameters",
    "LabellingParameters",
    "LastEpochParameters",
    "MissionParameters",
    "ModelParameters",
    "MotionMemoryParameters",
    "MovementParameters",
    "OutputParameters",
    "ParameterError",
    "ParameterSet",
    "ProjectParameters",
    "RawGroundParameters",
    "RegionParameters",
    "RegistrationParameters",
    "ReportParameters",
    "RoadParameters",
    "ScenesParameters",
    "ScreeningParameters",
    "SeriesParameters",
    "Specification",
    "SurfaceParameters",
    "SurveyParameters",
    "TopViewParameters",
    "ZoneParameters",
    "command_sets",
    "given",
    "profile_values",
]
