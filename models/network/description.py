"""What lies next to weights as JSON, and the kind of network that it says they are of. Needs no torch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...engine.core import checksums
from ...engine.core.errors import InputError
from ...engine.core.input_files import open_input
from ...engine.core.json_shapes import fields, maybe, number, read_json, rows, text
from ...engine.core.messages import shown
from ...engine.core.part_folders import settle
from ...interface.input_files import WEIGHTS

FORMAT = 1
POINTS = "RandLA-Net"
"""Kind of the network on points, whose descriptions need not name it."""
RELIEF = "relief U-Net"
_SENTENCE = "The description {path} of the weights cannot be read ({why}); restore it, or take other weights."
_LARGEST_FACTOR = 1000.0
_FACTOR, _SHIFT = number(0.0, _LARGEST_FACTOR, above=True), number(-_LARGEST_FACTOR, _LARGEST_FACTOR)
_DESCRIPTION = fields(
    {
        "format": number(whole=True),
        "sha256": text("[0-9a-f]{64}", "a SHA-256"),
        "configuration": fields({}),
    },
    {
        "kind": text("[ -~]{1,60}", "a name"),
        "calibration": maybe(fields({}, {"scale": _FACTOR, "shift": _SHIFT})),
        "metrics": maybe(fields({}, {"calibration": maybe(fields({}, {"temperature": _FACTOR}))})),
        "parameters": maybe(number(0, whole=True)),
    },
)
RELIEF_CONFIGURATION = fields(
    {
        "channels": rows(text(), 1, 64),
        "widths": rows(number(1, 1024, whole=True), 1, 8),
        "cell": number(0.0, above=True),
    }
)
"""Shape of the configuration of a network on relief; that on points has ``configuration.CONFIGURATION``."""


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
    settle(path.parent)
    source = path.with_suffix(".json")
    try:
        description = dict(read_json(source, _DESCRIPTION, _SENTENCE))
    except FileNotFoundError:
        raise InputError(
            f"The description {shown(source)} of the weights is missing; keep both files together."
        ) from None
    if description["format"] != FORMAT:
        raise InputError(
            f"The description {shown(source)} of the weights is of another version; take weights made for this one."
        )
    return description


def checked_description(path: Path, sha256: str | None = None) -> tuple[dict[str, Any], str]:
    """The description of weights, and their checksum, which is the stated one; the weights are not opened.

    Args:
        sha256: the checksum that they must have, where it is known from elsewhere; that of the description is checked
            in any case.

    Raises:
        InputError: a file is missing, pickled, tampered with or of another version.
    """
    if not path.is_file():
        raise InputError(f"The weights {path} do not exist; give a .safetensors file.")
    _refuse_pickle(path)
    description = read_description(path)
    found = checksums.sha256(path)
    for expected in (sha256, description["sha256"]):
        if expected is not None and found != expected:
            raise InputError(f"The weights {path} are not those their checksum names; download or train them again.")
    return description, found


def _refuse_pickle(path: Path) -> None:
    """A pickle can run any program when it is opened; torch's own files are pickles, plain or in a zip archive."""
    with open_input(path, WEIGHTS) as file:
        start = file.read(16)
    if path.suffix != ".safetensors" or start[:2] in (b"PK", b"\x80\x02", b"\x80\x04") or start[8:9] != b"{":
        raise InputError(
            f"The weights {path} are no safetensors file; pickled models are not opened, convert them first."
        )
