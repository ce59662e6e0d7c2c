"""The weights that come with SlopeWatch: where they are, and the checksums that they must have."""

from __future__ import annotations

from pathlib import Path

from ...engine.core.errors import InputError

SHIPPED_WEIGHTS = Path(__file__).resolve().parents[1] / "weights" / "slopewatch.safetensors"
"""Of the network on points."""
RELIEF_WEIGHTS = SHIPPED_WEIGHTS.with_name("relief.safetensors")
"""Of the network on rasters of relief."""


def pinned_sha256(weights: Path) -> str:
    """The checksum of shipped weights, as committed next to them; empty while there are none."""
    pin = weights.with_suffix(".sha256")
    return pin.read_text(encoding="ascii").split()[0] if pin.is_file() else ""


SHIPPED_SHA256 = pinned_sha256(SHIPPED_WEIGHTS)
RELIEF_SHA256 = pinned_sha256(RELIEF_WEIGHTS)


def shipped_model() -> tuple[Path, str]:
    """The shipped weights of the network on points and their checksum, for ``weights.load_model``.

    Raises:
        InputError: this copy of SlopeWatch has none.
    """
    return _there(SHIPPED_WEIGHTS, SHIPPED_SHA256)


def shipped_relief() -> tuple[Path, str]:
    """The same of the network on rasters of relief, for ``unet.load_unet``."""
    return _there(RELIEF_WEIGHTS, RELIEF_SHA256)


def _there(weights: Path, sha256: str) -> tuple[Path, str]:
    if not sha256 or not weights.is_file():
        raise InputError(
            f"The weights {weights} are missing from this copy of SlopeWatch; install it again, give --weights, or use "
            "--screening-method filter."
        )
    return weights, sha256
