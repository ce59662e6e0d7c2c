"""What is known of the registration of a pair: its transform's file states it, or the record beside the moved cloud."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..engine.core.arrays import Float
from ..engine.core.errors import InputError
from ..engine.core.json_shapes import fields, maybe, number, read_json, rows, text
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.geometry.rigid_transform import RigidTransform, registration_facts
from .run import record_name_of

ALIGNED_SHA256 = "aligned_sha256"
"""In the record of ``register``: SHA-256 of the cloud that it wrote."""
_RECORD = fields(
    {
        "command": text("register", "that of register"),
        ALIGNED_SHA256: text(),
        "inputs": rows(fields({"role": text(), "sha256": text()})),
        "transform": rows(rows(number(), 4, 4), 4, 4),
        "registration": fields(
            {"centre": rows(number(), 3, 3), "registration_error_m": number(0.0)},
            {"covariance": maybe(rows(rows(number(), 6, 6), 6, 6)), "unobservable": rows(text())},
        ),
    }
)


@dataclass(frozen=True)
class KnownRegistration:
    """``transform`` moves the later survey to the reference, None where it is not known.

    ``facts`` are the figures of the registration. ``applied`` says that the cloud is the moved one already.
    """

    transform: RigidTransform | None = None
    facts: Mapping[str, Any] = field(default_factory=dict)
    applied: bool = False

    @property
    def to_apply(self) -> RigidTransform | None:
        """What still moves the later cloud."""
        return None if self.applied else self.transform

    @property
    def centre(self) -> Float | None:
        """What the transform turns about, (3,) m."""
        return None if self.transform is None else self.transform.centre

    def or_recorded(self, moving: Path, hashes: tuple[str, ...], progress: Progress) -> KnownRegistration:
        """This one, or that of the record beside ``moving`` if none is given; see ``recorded_registration``."""
        return self if self.transform is not None else recorded_registration(moving, hashes, progress)

    @property
    def error(self) -> float | None:
        """Standard error in height (m), where it is stated."""
        known = self.facts.get("registration_error_m")
        if isinstance(known, (int, float)) and math.isfinite(known) and known >= 0:
            return float(known)
        return None


def given_registration(transform_path: Path | None) -> KnownRegistration:
    """As the file of a transform states it.

    Raises:
        InputError: see ``RigidTransform.load``.
    """
    if transform_path is None:
        return KnownRegistration()
    return KnownRegistration(RigidTransform.load(transform_path), registration_facts(transform_path))


def recorded_registration(moving: Path, hashes: tuple[str, ...], progress: Progress) -> KnownRegistration:
    """As the record of ``register`` beside ``moving`` states it.

    It counts only if it was written for this very cloud and this reference.

    Args:
        hashes: SHA-256 of the reference and of ``moving``.
    """
    path = moving.with_name(record_name_of(moving))
    try:
        record = read_json(path, _RECORD, "{path} is no record of a registration ({why}).")
        references = [entry["sha256"] for entry in record["inputs"] if entry["role"] == "reference"]
        if (*references, record[ALIGNED_SHA256]) != hashes:
            return KnownRegistration()
        facts = dict(record["registration"])
        transform = RigidTransform.from_matrix(np.array(record["transform"]), np.array(facts.pop("centre")))
    except (FileNotFoundError, InputError, ValueError):  # another file of that name is none of our business
        return KnownRegistration()
    progress.info(f"The registration error of {facts['registration_error_m']:.3f} m is that of {shown(path)}.")
    return KnownRegistration(transform, facts, applied=True)
