"""The network behind screening: found, checked and run; torch is imported only when it is asked for."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...engine.core.errors import EngineError, InputError
from ...engine.core.processors import processors
from ...engine.core.progress import Progress
from ...interface.parameters import ScreeningParameters, given

if TYPE_CHECKING:
    from ..configuration import ModelConfiguration
    from ..network.weights import ModelFile
    from ..preparation.prepare import PreparedCloud

_OUT_OF_MEMORY = ("not enough memory", "can't allocate memory", "out of memory")
"""What torch says where it raises a plain RuntimeError."""


MAX_THREADS = 8
"""By default: each works on a window of its own, which takes memory, and preparing these takes a third of the time."""


class ScreeningModel:
    """A network ready to run, as the parameters ask for it.

    Raises:
        InputError: torch is missing; the weights are missing, pickled or not what their checksum says; there is no
            graphics card where one is asked for.
    """

    def __init__(self, parameters: ScreeningParameters) -> None:
        from ..network.availability import chosen_device, require_libraries

        require_libraries("Screening with the network", "or use --screening-method filter")
        from ..inference.calibration import temperature_of
        from ..network.randlanet import fold_normalisation
        from ..network.shipped import shipped_model
        from ..network.weights import load_model

        self.device = chosen_device(parameters.device)
        if parameters.weights:
            self.path, pin = Path(parameters.weights), None
        else:
            self.path, pin = shipped_model()
        self.file: ModelFile = load_model(self.path, pin)
        self.network = fold_normalisation(self.file.network).to(self.device)
        self.temperature = temperature_of(self.file.metadata)
        self.rotations = parameters.rotations
        self.threads = int(given(parameters.threads) or min(processors(), MAX_THREADS))

    @property
    def configuration(self) -> ModelConfiguration:
        return self.file.configuration

    def facts(self) -> dict[str, Any]:
        """What the run record says of the model."""
        import torch

        return {
            "name": self.configuration.name,
            "sha256": self.file.sha256,
            "parameters": self.file.metadata.get("parameters"),
            "simulator_version": self.file.metadata.get("simulator_version"),
            "temperature": self.temperature,
            "device": str(self.device),
            "threads": self.threads,
            "torch": torch.__version__,
        }

    def probabilities(self, cloud: PreparedCloud, progress: Progress) -> NDArray[np.float32]:
        """(m, 3) of a prepared cloud's voxels.

        Raises:
            EngineError: memory ran out.
            InputError: the network's answers are no numbers.
        """
        from ..inference.prediction import predict_voxels

        with one_torch_thread(), memory_reported():
            found, _ = predict_voxels(
                self.network,
                cloud,
                rotations=self.rotations,
                threads=self.threads,
                device=self.device,
                progress=progress,
            )
        refuse_senseless(found, self.path)
        return found


def refuse_senseless(answers: NDArray[np.floating], weights: Path) -> None:
    """Raise InputError if a network's answers are no numbers: each of its weights may be one, and yet all too large."""
    if not np.isfinite(answers).all():
        raise InputError(f"The weights {weights} give answers that are no numbers; download or train them again.")


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Windows are what is worked on side by side: within one, sums would depend on the number of threads.

    Does nothing where torch is not at work.
    """
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def memory_reported() -> Iterator[None]:
    """Turn every way of running out of memory into one sentence."""
    try:
        yield
    except MemoryError as error:
        raise _no_memory() from error
    except RuntimeError as error:
        if type(error).__name__ == "OutOfMemoryError" or any(t in str(error).lower() for t in _OUT_OF_MEMORY):
            raise _no_memory() from error
        raise


def _no_memory() -> EngineError:
    return EngineError(
        "Memory ran out while screening; give fewer --threads, --device cpu, or cut the cloud with --roi."
    )
