"""The labelled points in and around screened zones, as the sheets of these zones show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ....interface.input_files import CLOUD
from ...core.arrays import Bool, Float
from ...core.errors import InputError
from ...core.input_files import open_input

LABELS = "slopewatch_class"
"""Dimension of the labelled cloud: 0 background, 1 uplift, 2 subsidence."""
MAX_POINTS = 20_000_000
"""Of a cloud that is read for the sheets: about 10 s."""
_CHUNK = 1_000_000
_MARGIN_SHARE, _MIN_MARGIN_M = 0.6, 3.0  # around a zone
_MOST_POINTS = 400_000  # held of one zone's surroundings; of more, every second, third and so on
_MIN_TREND_POINTS = 30


@dataclass(frozen=True)
class ScreenedGround:
    """Points (n, 3) in and around a zone, metres, their ``labels`` (n,), and which of them are ``inside`` it (n,)."""

    points: Float
    labels: NDArray[np.uint8]
    inside: Bool

    def share(self, label: int) -> float | None:
        """Of the zone's points with that label; None where it holds no point."""
        own = self.labels[self.inside]
        return float(np.mean(own == label)) if len(own) else None

    def over_trend(self) -> Float:
        """(n,) heights over the curved surface through the ground around the zone, metres; NaN where it is unknown."""
        middle = self.points.mean(axis=0)
        x, y, z = (self.points - middle).T
        terms = np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])
        around = ~self.inside & (self.labels == 0)
        if np.count_nonzero(around) < _MIN_TREND_POINTS:
            return np.full(len(z), np.nan)
        for _ in range(3):  # what stands out of the surroundings is no part of their surface
            found, *_ = np.linalg.lstsq(terms[around], z[around], rcond=None)
            rest = z - terms @ found
            spread = 1.4826 * float(np.median(np.abs(rest[around])))
            around &= np.abs(rest) <= 3.0 * max(spread, 1e-3)
        return np.asarray(rest)


def screened_ground(path: Path, zones: Sequence[BaseGeometry]) -> list[ScreenedGround] | None:
    """Of each zone what the labelled cloud holds in and around it.

    None where there is no cloud, it cannot be read, has no labels, or is too large to be read for a report.
    """
    try:
        with open_input(path, CLOUD) as stream, laspy.open(stream) as source:
            if source.header.point_count > MAX_POINTS or LABELS not in source.header.point_format.dimension_names:
                return None
            boxes = [surroundings(zone) for zone in zones]
            parts: list[list[NDArray[np.float64]]] = [[] for _ in zones]
            for chunk in source.chunk_iterator(_CHUNK):
                whole = np.column_stack([chunk.x, chunk.y, chunk.z, np.asarray(chunk[LABELS])])
                for number, (west, south, east, north) in enumerate(boxes):
                    x, y = whole[:, 0], whole[:, 1]
                    parts[number].append(whole[(x >= west) & (x <= east) & (y >= south) & (y <= north)])
    except (InputError, OSError, ValueError, laspy.errors.LaspyException):
        return None
    return [
        _ground(np.concatenate(own) if own else np.zeros((0, 4)), zone) for own, zone in zip(parts, zones, strict=True)
    ]


def surroundings(zone: BaseGeometry) -> tuple[float, float, float, float]:
    """West, south, east and north of what a zone's sheet shows."""
    west, south, east, north = zone.bounds
    margin = max(_MIN_MARGIN_M, _MARGIN_SHARE * max(east - west, north - south))
    return west - margin, south - margin, east + margin, north + margin


def _ground(found: NDArray[np.float64], zone: BaseGeometry) -> ScreenedGround:
    found = found[:: max(1, -(-len(found) // _MOST_POINTS))]
    inside = np.asarray(shapely.contains_xy(zone, found[:, 0], found[:, 1]))
    return ScreenedGround(found[:, :3], found[:, 3].astype(np.uint8), inside)
