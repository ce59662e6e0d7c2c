"""Rigid motions: applied without loss at projected coordinates, saved with direction and frame stated.

A registration that bends carries a correction of heights in addition to its rigid motion.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS

from ...interface.input_files import TRANSFORM
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.json_shapes import fields, maybe, number, read_json, rows, text
from ..core.messages import shown
from ..core.staged_outputs import atomic_output
from .height_correction import HeightCorrection

_AFTER = "after the matrix: add to z the bilinear interpolation of heights at x and y (rows from south to north)"
_BEFORE = "before the matrix: take from z the bilinear interpolation of heights at x and y (rows from south to north)"
_SENTENCE = (
    "{path} holds no usable transform ({why}); give a transform.json that SlopeWatch wrote, or one with a rigid 4 by 4 "
    "matrix."
)
_VECTOR = rows(number(), 3, 3)
_HEIGHTS = rows(rows(number(), 2), 2)
_SHAPE = fields(
    {"matrix": rows(rows(number(), 4, 4), 4, 4)},
    {
        "centre": maybe(_VECTOR),
        "translation": _VECTOR,
        "rotation": rows(_VECTOR, 3, 3),
        "pieces": fields(
            {
                "west": number(), "south": number(), "spacing": number(0.0, above=True), "heights": _HEIGHTS,
                "standard_errors": _HEIGHTS,
            },
            {"order": text()},
        ),
        "registration": maybe(fields({}, {"unobservable": maybe(rows(text())), "registration_method": maybe(text())})),
    },
)  # fmt: skip
_MAX_ROUNDING = 1e-6  # largest deviation of R R' from the identity that is rounding and not a scale


@dataclass(frozen=True)
class RigidTransform:
    """x' = R (x - centre) + centre + translation, in metres.

    Rotating about a centre near the points keeps their digits; a rotation about the origin of a projected system
    would multiply coordinates of millions of metres. ``rotation`` (3, 3), ``translation`` (3,), ``centre`` (3,).
    """

    rotation: Float
    translation: Float
    centre: Float

    @classmethod
    def identity(cls) -> RigidTransform:
        return cls(np.eye(3), np.zeros(3), np.zeros(3))

    @classmethod
    def from_matrix(cls, matrix: Float, centre: Float | None = None) -> RigidTransform:
        """From a (4, 4) matrix, about ``centre`` (by default the origin).

        Raises:
            ValueError: the matrix is not of a rigid motion.
        """
        matrix = np.asarray(matrix, dtype=np.float64)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or not np.array_equal(matrix[3], [0, 0, 0, 1]):
            raise ValueError("not a 4 by 4 matrix of finite numbers with the last row 0 0 0 1")
        rotation = matrix[:3, :3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > _MAX_ROUNDING or np.linalg.det(rotation) < 0:
            raise ValueError("not a rigid motion: its rotation scales, shears or mirrors")
        centre = np.zeros(3) if centre is None else np.asarray(centre, dtype=np.float64)
        return cls(rotation, matrix[:3, 3] + rotation @ centre - centre, centre)

    @property
    def matrix(self) -> Float:
        """(4, 4), for coordinates of the clouds' reference system."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.translation + (self.centre - self.rotation @ self.centre)
        return matrix

    @property
    def angle(self) -> float:
        """Angle of the rotation, radians; exact also where it is tiny."""
        r = self.rotation
        sine = np.linalg.norm([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2
        return math.atan2(float(sine), (float(np.trace(r)) - 1) / 2)

    def apply(self, xyz: Float) -> Float:
        """Moved copy of the points (n, 3)."""
        return (xyz - self.centre) @ self.rotation.T + (self.centre + self.translation)

    def inverse(self) -> RigidTransform:
        return RigidTransform(self.rotation.T, -self.rotation.T @ self.translation, self.centre)

    def save(self, path: Path, crs: CRS, facts: Mapping[str, Any] | None = None) -> None:
        """Write as JSON: ``matrix`` row by row, moving to reference, and what is needed to use it rightly.

        Args:
            facts: figures of the registration, written into the same file.
        """
        document = {
            "matrix": self.matrix.tolist(),
            "direction": "moving to reference: reference = matrix * moving",
            "frame": {"crs": crs.to_string(), "unit": "metre"},
            "rotation": self.rotation.tolist(),
            "translation": self.translation.tolist(),
            "centre": self.centre.tolist(),
            "rotation_angle_rad": self.angle,
            "registration": dict(facts or {}),
        } | self._more()
        with atomic_output(path) as partial:
            partial.write_text(json.dumps(document, indent=2, allow_nan=False), encoding="utf-8")

    def _more(self) -> dict[str, Any]:
        """What a transform that is not rigid alone adds to its file."""
        return {}

    @classmethod
    def load(cls, path: Path) -> RigidTransform:
        """Read what ``save`` wrote, or any JSON with a rigid ``matrix``.

        Raises:
            InputError: missing, not JSON, or not a rigid motion.
        """
        document = _read(Path(path))
        try:
            centre = document.get("centre")
            loaded = RigidTransform.from_matrix(np.array(document["matrix"], dtype=np.float64), centre)
            if centre is not None and "rotation" in document and "translation" in document:
                exact = RigidTransform(
                    np.array(document["rotation"], dtype=np.float64),
                    np.array(document["translation"], dtype=np.float64),
                    np.array(centre, dtype=np.float64),
                )
                if np.abs(exact.matrix - loaded.matrix).max() > 1e-6:
                    raise ValueError("its matrix contradicts its rotation and translation")
                loaded = exact
            if "pieces" in document:
                correction = HeightCorrection.from_facts(document["pieces"])
                bent = BentTransform(loaded.rotation, loaded.translation, loaded.centre, correction)
                return bent.backwards() if document["pieces"].get("order") == _BEFORE else bent
            return loaded
        except ValueError as error:
            raise InputError(_SENTENCE.format(path=shown(path), why=error)) from error


@dataclass(frozen=True)
class BentTransform(RigidTransform):
    """The rigid motion, then ``correction`` of the heights; or, ``inverted``, the correction removed and then the
    rigid motion. ``matrix`` is the rigid part.
    """

    correction: HeightCorrection
    inverted: bool = False

    @property
    def rigid(self) -> RigidTransform:
        """The rigid part alone."""
        return RigidTransform(self.rotation, self.translation, self.centre)

    def apply(self, xyz: Float) -> Float:
        if self.inverted:
            return super().apply(self.correction.undo(xyz))
        return self.correction.apply(super().apply(xyz))

    def inverse(self) -> BentTransform:
        back = self.rigid.inverse()
        # (R x + ...) about the same centre, so that the digits are kept
        return BentTransform(back.rotation, back.translation, back.centre, self.correction, not self.inverted)

    def backwards(self) -> BentTransform:
        """The same rigid part with the correction removed before it."""
        return BentTransform(self.rotation, self.translation, self.centre, self.correction, not self.inverted)

    def _more(self) -> dict[str, Any]:
        return {"pieces": self.correction.facts() | {"order": _BEFORE if self.inverted else _AFTER}}


def registration_facts(transform_path: Path) -> dict[str, Any]:
    """What the transform's file records of the registration that found it; a word that stands for no number is left
    out, as the record of a run holds numbers.

    Raises:
        InputError: the file is missing or no transform.
    """
    recorded = _read(transform_path).get("registration") or {}
    return {name: value for name, value in recorded.items() if not _is_no_number(value)}


def _is_no_number(value: Any) -> bool:
    try:
        return isinstance(value, str) and not math.isfinite(float(value))
    except ValueError:  # a word
        return False


def _read(path: Path) -> dict[str, Any]:
    try:
        return dict(read_json(path, _SHAPE, _SENTENCE, TRANSFORM))
    except FileNotFoundError as error:
        raise InputError(_SENTENCE.format(path=shown(path), why="it does not exist")) from error
