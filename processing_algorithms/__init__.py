"""The toolbox: one algorithm a file; each only declares its parameters and calls the engine."""

from .checkenvironment import CheckEnvironment
from .cloudinfo import CloudInfo
from .compareflight import CompareFlight
from .corridorbatch import CorridorBatch
from .createproject import CreateProject
from .demchange import DemChange
from .displacementvectors import DisplacementVectors
from .elevationchange import ElevationChange
from .exportgis import ExportGis
from .exportlabelstudio import ExportLabelStudio
from .extractground import ExtractGround
from .importlabelstudio import ImportLabelStudio
from .inspectseries import InspectSeries
from .inspectslope import InspectSlope
from .locateonroad import LocateOnRoad
from .m3c2distances import M3C2Distances
from .planflight import PlanFlight
from .registerepochs import RegisterEpochs
from .screenhazards import ScreenHazards
from .setupengine import SetupEngine
from .simulatescenes import SimulateScenes
from .simulateseries import SimulateSeries
from .simulatesurvey import SimulateSurvey
from .suggestroi import SuggestRoi
from .topview import TopView
from .trainmodel import TrainModel
from .writereport import WriteReport

ALGORITHMS = (
    InspectSlope,
    InspectSeries,
    CorridorBatch,
    ScreenHazards,
    ExtractGround,
    RegisterEpochs,
    ElevationChange,
    M3C2Distances,
    DemChange,
    DisplacementVectors,
    LocateOnRoad,
    WriteReport,
    ExportGis,
    CreateProject,
    TopView,
    SuggestRoi,
    PlanFlight,
    CompareFlight,
    ExportLabelStudio,
    ImportLabelStudio,
    SimulateSurvey,
    SimulateSeries,
    SimulateScenes,
    TrainModel,
    SetupEngine,
    CloudInfo,
    CheckEnvironment,
)
