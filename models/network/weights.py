"""Weights as safetensors with their description next to them, pinned by a checksum. Pickled files are refused."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ...engine.core import checksums
from ...engine.core.errors import InputError
from ...engine.core.messages import shown
from ...engine.core.staged_outputs import atomic_output
from ..configuration import ModelConfiguration
from .description import FORMAT, checked_description
from .randlanet import RandLANet


@dataclass(frozen=True)
class ModelFile:
    """A model read from disk: network in evaluation mode, its configuration, what is known of it, its checksum."""

    network: RandLANet
    configuration: ModelConfiguration
    metadata: dict[str, Any]
    sha256: str


def save_model(
    path: Path,
    network: RandLANet,
    training: dict[str, Any],
    metrics: dict[str, Any],
    *,
    simulator_version: int | None = None,
) -> str:
    """Write weights and, next to them, a JSON file with configuration, training, metrics and checksum.

    Args:
        simulator_version: of the simulator whose scenes the network learnt from; None where it saw none.

    Returns:
        The weights' SHA-256.

    Raises:
        InputError: the folder does not exist or cannot be written, or the name does not end in .safetensors.
    """
    facts = {
        "configuration": asdict(network.configuration),
        "parameters": network.parameter_count,
        "simulator_version": simulator_version,
        "training": training,
        "metrics": metrics,
    }
    return save_tensors(path, network.state_dict(), facts)


def save_tensors(path: Path, tensors: Mapping[str, Tensor], facts: dict[str, Any]) -> str:
    """Write tensors and, next to them, a JSON file of facts with their checksum, which is returned.

    Raises:
        InputError: as ``save_model``.
    """
    from safetensors.torch import save_file

    if path.suffix != ".safetensors":
        raise InputError(f"The weights' name {path.name} does not end in .safetensors; give one that does.")
    with atomic_output(path) as partial:
        save_file({name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}, str(partial))
    digest = checksums.sha256(path)
    with atomic_output(path.with_suffix(".json")) as partial:
        text = json.dumps({"format": FORMAT, "sha256": digest, **facts}, indent=2, ensure_ascii=False)
        partial.write_text(text + "\n", encoding="utf-8")
    return digest


def load_model(path: Path, sha256: str | None = None) -> ModelFile:
    """Read weights and their description; nothing in either is executed.

    Args:
        sha256: the checksum that the weights must have, where it is known from elsewhere; that of the description is
            checked in any case.

    Raises:
        InputError: a file is missing, pickled, tampered with or not made for this version.
    """
    description, tensors, found = load_tensors(path, sha256)
    configuration = configuration_of(path, description)
    network = RandLANet(configuration)
    try:
        network.load_state_dict(tensors)
    except RuntimeError as error:
        raise InputError(f"The weights {path} do not fit their description; take both from one source.") from error
    network.eval()
    return ModelFile(network, configuration, description, found)


def configuration_of(path: Path, description: Mapping[str, Any]) -> ModelConfiguration:
    """The configuration that the description of the weights ``path`` states.

    Raises:
        InputError: it is none of this version.
    """
    try:
        return ModelConfiguration.from_mapping(description["configuration"])
    except InputError as error:
        raise InputError(f"The description of the weights {shown(path)} cannot be used: {error}") from error


def load_tensors(path: Path, sha256: str | None = None) -> tuple[dict[str, Any], dict[str, Tensor], str]:
    """The description, the tensors and the checksum of weights, both files checked as by ``load_model``."""
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    path = Path(path)
    description, found = checked_description(path, sha256)
    try:
        tensors = load_file(str(path))
        sound = all(bool(torch.isfinite(tensor).all()) for tensor in tensors.values() if tensor.is_floating_point())
    except (SafetensorError, RuntimeError, ValueError, KeyError) as error:
        raise InputError(f"The weights {path} do not fit their description; take both from one source.") from error
    if not sound:
        raise InputError(f"The weights {path} hold what is no number; download or train them again.")
    return description, tensors, found
