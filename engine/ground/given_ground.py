"""The ground that a survey gives itself: its points of class 2, or all of its points."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from laspy import DecompressionSelection

from ...interface.parameters import GroundParameters, RawGroundParameters
from ..core.arrays import Bool, Float
from ..core.errors import InputError
from ..core.messages import shown
from ..geometry.point_spacing import point_spacing
from ..pointcloud.extent import square_metres
from ..pointcloud.header import preflight
from ..pointcloud.records import PLACES, coordinates, read_records
from .classified_ground import Warn, warn_of_classes, warn_of_lower_points
from .filtering import dominant_plane
from .findings import Outcome
from .pdal_pipelines import GROUND, NOISE
from .result import AS_IS, CLASS_2
from .tally import square_keys

_MAX_SAMPLE_POINTS, _SQUARE_SIDE_M = 2_000_000, 10.0
"""A larger cloud is judged in whole squares that hold about so many points."""
_SCATTERING = np.uint64(0x9E3779B97F4A7C15)  # odd; scatters the numbers of adjoining squares
_CLASSES = DecompressionSelection.XY_RETURNS_CHANNEL | DecompressionSelection.CLASSIFICATION
_LOOKED_AT_STRETCHES = 12


@dataclass(frozen=True)
class GivenGround:
    """``mask`` (n,) says which points are ground; ``area`` (m²) of the squares of a metre that all of them cover.

    ``xyz`` (m, 3), ``ground`` and ``noise`` (m,) are a sample of the points in whole squares, metres.
    """

    mask: Bool
    area: float
    xyz: Float
    ground: Bool
    noise: Bool

    def outcome(self, ground: str) -> Outcome:
        """What an extraction reports. Vegetation is not measured: its classes are those of somebody else."""
        plane = dominant_plane(self.xyz[self.ground])
        return Outcome(
            points=len(self.mask),
            area=self.area,
            ground_points=int(np.count_nonzero(self.mask)),
            outliers=0,
            vegetation_cover=None,
            spacing=point_spacing(self.xyz),
            plane=plane,
            scatter=0.0,
            threshold=0.0,
            method=CLASS_2 if ground == "class_2" else AS_IS,
            cover=None,
        )


def given_choice(parameters: GroundParameters) -> str:
    """class_2 or as_is; empty where the ground is extracted."""
    ground = parameters.ground if isinstance(parameters, RawGroundParameters) else "extract"
    return "" if ground == "extract" else ground


def given_ground(plain: Path, ground: str, *, flags_in_class: bool = False) -> GivenGround:
    """The ground among the points of a clipped cloud, which is read in parts.

    Args:
        ground: class_2 or as_is.
    """
    header = preflight(plain)
    share = _MAX_SAMPLE_POINTS / max(header.count, 1)
    mask, covered = np.ones(header.count, dtype=bool), np.empty(0, dtype=np.int64)
    sample: list[tuple[Float, Bool, Bool]] = []
    done = 0
    for records in read_records(header, selection=PLACES | DecompressionSelection.CLASSIFICATION):
        xyz, labels = coordinates(records, header), np.asarray(records["classification"])
        labels = labels & 0x1F if flags_in_class else labels
        part = slice(done, done + len(records))
        if ground == "class_2":
            mask[part] = labels == GROUND
        covered = np.union1d(covered, square_metres(xyz))
        taken = _in_sample(xyz, share)
        sample.append((xyz[taken], mask[part][taken], np.isin(labels[taken], NOISE)))
        done = part.stop
    xyz, is_ground, noise = (np.concatenate(arrays) for arrays in zip(*sample, strict=True))
    return GivenGround(mask, float(len(covered)), xyz, is_ground, noise)


def _in_sample(xyz: Float, share: float) -> Bool:
    """(n,) whether the square of each of the points (n, 2+) is one of those, a ``share`` of all, that are judged."""
    square = square_keys(np.floor(xyz[:, :2] / _SQUARE_SIDE_M).astype(np.int64)).astype(np.uint64)
    return np.asarray((square * _SCATTERING >> np.uint64(32)) < share * 2**32, dtype=np.bool_)


def judge_classes(cloud: Path, found: GivenGround, warn: Warn) -> None:
    """Warn if the points of class 2 contradict each other or the points below them.

    Raises:
        InputError: there are none, or they are no surface.
    """
    if not found.mask.any():
        raise InputError(f"{shown(cloud)} has no points of class 2 in the region; extract its ground instead.")
    xyz = found.xyz[found.ground]
    warn_of_classes(cloud, xyz, warn)
    warn_of_lower_points(cloud, xyz, found.xyz[~(found.ground | found.noise)], warn)


def has_class_2(cloud: Path, *, every: bool = True) -> bool:
    """Whether a cloud has points of class 2.

    Args:
        every: all points are looked at, until one is found; else some stretches, evenly over the file.

    Raises:
        InputError: see ``preflight``; damaged points.
    """
    stretches = None if every else _LOOKED_AT_STRETCHES
    parts = read_records(preflight(cloud), selection=_CLASSES, stretches=stretches)
    return any(bool((np.asarray(records["classification"]) == GROUND).any()) for records in parts)
