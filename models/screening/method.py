"""Which method screens, and the network that it needs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ...engine.core.errors import InputError
from ...interface.parameters import AUTO, ScreeningParameters
from ..network.description import POINTS, RELIEF, kind_of
from .network import ScreeningModel
from .relief import ReliefModel

DEFAULT = "relief"
KINDS = {"relief": RELIEF, "network": POINTS}
"""Kind of the weights that a method reads."""


def with_method(parameters: ScreeningParameters) -> ScreeningParameters:
    """The parameters with a method in the place of AUTO: what the weights are for, or ``DEFAULT`` without weights.

    Raises:
        InputError: the weights are missing or undescribed, or those of another method than the one asked for.
    """
    method = parameters.screening_method
    if not parameters.weights or method not in (*KINDS, AUTO):
        return replace(parameters, screening_method=DEFAULT if method == AUTO else method)
    path = Path(parameters.weights)
    if not path.is_file():
        raise InputError(f"The weights {path} do not exist; give a .safetensors file.")
    kind = kind_of(path)
    fitting = [name for name, wanted in KINDS.items() if wanted == kind]
    if not fitting:
        raise InputError(f"The weights {path} are those of a {kind}, which this version does not know; give others.")
    if method not in (*fitting, AUTO):
        raise InputError(
            f"The weights {path} are those of a {kind}, for the method {fitting[0]}; give --screening-method "
            f"{fitting[0]}, or weights for {method}."
        )
    return replace(parameters, screening_method=fitting[0])


def learned_model(parameters: ScreeningParameters) -> ScreeningModel | ReliefModel | None:
    """The network of the parameters' method, ready to run; None if it needs none.

    Raises:
        InputError: see ``with_method`` and the models.
    """
    method = with_method(parameters).screening_method
    if method == "relief":
        return ReliefModel(parameters)
    return ScreeningModel(parameters) if method == "network" else None
