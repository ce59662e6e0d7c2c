"""Where a training stands, kept in two files so that it goes on later as if it had not stopped; nothing is pickled."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn
from torch.optim.lr_scheduler import LRScheduler

from ...engine.core.errors import InputError
from ...engine.core.staged_outputs import atomic_output


class Checkpoint:
    """``folder/checkpoint.safetensors`` with all that the next step depends on, ``checkpoint.json`` with what training
    it is of: its ``identity``, settings that JSON can hold.
    """

    def __init__(self, folder: Path, identity: Mapping[str, Any]) -> None:
        self.tensors, self.state = folder / "checkpoint.safetensors", folder / "checkpoint.json"
        self.identity: dict[str, Any] = json.loads(json.dumps(identity))

    def save(self, tensors: Mapping[str, Tensor], step: int) -> None:
        """Write tensors and the number of steps done."""
        # The step is in the tensors' file too, so that the two files cannot be of different steps unnoticed.
        kept = {name: tensor.detach().cpu().clone().contiguous() for name, tensor in tensors.items()}
        with atomic_output(self.tensors) as partial:
            save_file({**kept, "step": torch.tensor(step)}, str(partial))
        with atomic_output(self.state) as partial:
            partial.write_text(json.dumps({"step": step, **self.identity}, indent=2), encoding="utf-8")

    def load(self, device: torch.device | None = None) -> tuple[dict[str, Tensor], int] | None:
        """Tensors on ``device`` and the number of steps done; None where there is no checkpoint.

        Raises:
            InputError: the checkpoint is of another training.
        """
        if not (self.tensors.is_file() and self.state.is_file()):
            return None
        state = json.loads(self.state.read_text(encoding="utf-8"))
        if {name: state.get(name) for name in self.identity} != self.identity:
            raise InputError(
                f"{self.state} is the checkpoint of a training with other settings; choose another folder or remove it."
            )
        tensors = load_file(str(self.tensors), device=str(device or torch.device("cpu")))
        return tensors, int(tensors.pop("step"))


def module_tensors(module: nn.Module, prefix: str) -> dict[str, Tensor]:
    """A module's state under names that begin with ``prefix``."""
    return {f"{prefix}.{name}": tensor for name, tensor in module.state_dict().items()}


def restore_module(module: nn.Module, prefix: str, tensors: Mapping[str, Tensor]) -> None:
    """Give a module back what ``module_tensors`` took."""
    start = f"{prefix}."
    module.load_state_dict({name.removeprefix(start): t for name, t in tensors.items() if name.startswith(start)})


def moments(optimiser: torch.optim.Optimizer) -> dict[str, Tensor]:
    """The optimiser's moments and counts under names that begin with ``optimiser``."""
    return {
        f"optimiser.{index}.{name}": torch.as_tensor(value)
        for index, values in optimiser.state_dict()["state"].items()
        for name, value in values.items()
    }


def restore_moments(optimiser: torch.optim.Optimizer, tensors: Mapping[str, Tensor]) -> None:
    """Give an optimiser back what ``moments`` took."""
    found: dict[int, dict[str, Tensor]] = {}
    for name, tensor in tensors.items():
        if name.startswith("optimiser."):
            _, index, key = name.split(".", 2)
            # Counts of steps stay on the processor, wherever the network is.
            found.setdefault(int(index), {})[key] = tensor.cpu() if key == "step" else tensor
    known = optimiser.state_dict()
    known["state"] = found
    optimiser.load_state_dict(known)


def advance(schedule: LRScheduler, steps: int) -> None:
    """Bring a fresh schedule to where it is after so many steps."""
    with warnings.catch_warnings():
        # Torch wants the optimiser to step first, which it did before the training stopped.
        warnings.filterwarnings("ignore", "Detected call of `lr_scheduler.step", UserWarning)
        for _ in range(steps):
            schedule.step()
