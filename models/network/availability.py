"""Whether what networks need is on this machine; torch is imported only here and only when asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...engine.core.errors import InputError

if TYPE_CHECKING:
    import torch


def require_libraries(task: str, otherwise: str = "", libraries: Sequence[str] = ("torch", "safetensors")) -> None:
    """Raise InputError, with what to do, where one of the libraries cannot be imported.

    Args:
        task: what needs them, as the sentence begins. otherwise: what else can be done, as it ends.
    """
    for name in libraries:
        try:
            __import__(name)
        except (ImportError, OSError) as error:
            raise InputError(
                f"{task} needs the Python library {name}, which cannot be imported ({error}); run Set up engine in "
                "QGIS with Add PyTorch, or install slopewatch[screening] in the engine's environment"
                f"{', ' + otherwise if otherwise else ''}."
            ) from error


def chosen_device(name: str) -> torch.device:
    """The device of ``cpu``, ``gpu`` or ``auto``.

    Raises:
        InputError: gpu, and there is none that torch can use.
    """
    import torch

    if name == "cpu" or (name == "auto" and not torch.cuda.is_available()):
        return torch.device("cpu")
    if not torch.cuda.is_available():
        raise InputError("device is gpu, but torch finds no graphics card here that it can use; give --device cpu.")
    return torch.device("cuda")
