"""The toolbox: one algorithm a file; each only declares its parameters and calls the engine."""

from .checkenvironment import CheckEnvironment
from .elevationchange import ElevationChange
from .extractground import ExtractGround
from .inspectslope import InspectSlope
from .registerepochs import RegisterEpochs
from .screenhazards import ScreenHazards
from .simulatescenes import SimulateScenes
from .simulatesurvey import SimulateSurvey
from .trainmodel import TrainModel

ALGORITHMS = (
    InspectSlope,
    ScreenHazards,
    ExtractGround,
    RegisterEpochs,
    ElevationChange,
    SimulateSurvey,
    SimulateScenes,
    TrainModel,
    CheckEnvironment,
)
