"""What lies next to weights as JSON, and the kind of network that it says they are of. Needs no torch."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ...engine.core.errors import InputError

FORMAT = 1
POINTS = "RandLA-Net"
"""Kind of the network on points, whose descriptions need not name it."""
RELIEF = "relief U-Net"


def kind_of(path: Path) -> str:
    """The kind of the network whose weights ``path`` holds.

    Raises:
        InputError: the file is no safetensors file, or see ``read_description``; the weights are not looked at.
    """
    if path.suffix != ".safetensors":
        raise InputError(
            f"The weights {path} are no safetensors file; pickled models are not opened, convert them first."
        )
    return str(read_description(path).get("kind", POINTS))


def read_description(path: Path) -> dict[str, Any]:
    """The JSON file next to the weights ``path``.

    Raises:
        InputError: it is missing, cannot be read, or is of another version.
    """
    source = path.with_suffix(".json")
    try:
        description = json.loads(source.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"The description {source} of the weights is missing; keep both files together.") from None
    except (ValueError, OSError) as error:
        raise InputError(f"The description {source} of the weights cannot be read ({error}); restore it.") from error
    if not isinstance(description, dict) or description.get("format") != FORMAT:
        raise InputError(
            f"The description {source} of the weights is of another version; take weights made for this one."
        )
    missing = {"sha256", "configuration"} - set(description)
    if missing:
        raise InputError(f"The description {source} of the weights lacks {', '.join(sorted(missing))}; restore it.")
    return description
