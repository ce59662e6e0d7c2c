"""The weights that come with SlopeWatch: where they are, and the checksum that they must have."""

from __future__ import annotations

from pathlib import Path

from ...engine.core.errors import InputError

SHIPPED_WEIGHTS = Path(__file__).resolve().parents[1] / "weights" / "slopewatch.safetensors"
_PIN = SHIPPED_WEIGHTS.with_name("slopewatch.sha256")


def shipped_sha256() -> str:
    """The checksum of the shipped weights, as committed next to them; empty while there are none."""
    return _PIN.read_text(encoding="ascii").split()[0] if _PIN.is_file() else ""


SHIPPED_SHA256 = shipped_sha256()


def shipped_model() -> tuple[Path, str]:
    """The shipped weights and their checksum, for ``weights.load_model``.

    Raises:
        InputError: this copy of SlopeWatch has none.
    """
    if not SHIPPED_SHA256 or not SHIPPED_WEIGHTS.is_file():
        raise InputError(
            f"The weights {SHIPPED_WEIGHTS} are missing from this copy of SlopeWatch; install it again, give "
            "--weights, or use --screening-method residual."
        )
    return SHIPPED_WEIGHTS, SHIPPED_SHA256
