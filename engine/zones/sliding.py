"""Zones of a change together with what their ground did: what slid is one zone, with its head and its toe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import geopandas as gpd
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import ndimage

from ...interface.parameters import ZoneParameters
from ..core.arrays import Index
from ..grid.grid import Grid
from .extraction import Zones
from .fields import SEVERITIES
from .footprints import plain_footprints
from .movement import GAINED, LOST, SLID, UNDECIDED, Verdict, decide
from .movement_evidence import Measured
from .slide_table import Slide, Surface, said_of_zones, slide_frame
from .volumes import zone_volumes

_REACH_M = 2.0  # around ground that slid, in which a zone of heights belongs to it: windows blur its edge
_MIN_COMMON_SHARE = 0.5  # of such a zone
_BALANCE_ERRORS = 2.0  # of the volume of all parts, within which nothing left and nothing came


def with_movements(
    found: Zones,
    measured: Sequence[Measured | None],
    moving: Sequence[Slide],
    surface: Surface,
    parameters: ZoneParameters,
    confidence: float = 0.99,
) -> Zones:
    """The zones with what each did, and ground that slid in place of the zones of heights that are its parts.

    Args:
        measured: of each zone of ``found``.
        moving: ground that slid, found by its motion, largest first.
        surface: what the zones were made of.
        confidence: see ``movement.decide``.
    """
    verdicts = [Verdict(UNDECIDED, 0.0) if m is None else decide(m.evidence, confidence) for m in measured]
    parts = _parts(found, verdicts, moving, surface.grid)
    taken = {zone for of_one in parts for zone in of_one}
    slides = list(moving)
    for zone, (verdict, one) in enumerate(zip(verdicts, measured, strict=True)):
        if verdict.movement == SLID and zone not in taken and one is not None:
            cells = np.flatnonzero(found.labels.ravel() == zone + 1)
            slides.append(Slide.of(cells, one, float(found.frame["confidence"].iloc[zone]), verdict.confidence))
            parts.append((zone,))
            taken.add(zone)
    kept = np.array([zone for zone in range(len(verdicts)) if zone not in taken], dtype=np.int64)
    said = said_of_zones([(verdicts[zone], measured[zone]) for zone in kept])
    frame = found.frame.iloc[kept].reset_index(drop=True).assign(**said)
    if not slides:
        return replace(found, frame=frame)
    labels = _labels(found, kept, slides, parts)
    return _with_slides(replace(found, frame=frame, labels=labels), found, kept, (slides, parts), surface, parameters)


def _with_slides(
    base: Zones,
    found: Zones,
    kept: Index,
    sliding: tuple[Sequence[Slide], Sequence[tuple[int, ...]]],
    surface: Surface,
    parameters: ZoneParameters,
) -> Zones:
    """``base``, which has the kept zones' rows and the labels of all, with the slides' rows and volumes."""
    slides, parts = sliding
    cells, labels = surface.cells, base.labels
    others = np.where(labels > len(kept), labels - len(kept), 0).astype(np.int32)
    held = cells.layout.of(others)
    own = plain_footprints(cells, held, len(slides), gap=parameters.bridged_gap)
    footprints = [*(found.footprints[zone] for zone in kept), *own]
    volumes = zone_volumes(footprints[: len(kept)], cells, found.correlation)
    slid = zone_volumes(own, cells, found.correlation)
    rows = slide_frame(
        slides, [found.frame.iloc[list(p)] for p in parts], others, slid, surface, found.frame.crs, parameters
    )
    frame = gpd.GeoDataFrame(pd.concat([base.frame, rows], ignore_index=True), crs=found.frame.crs)
    volumes = volumes.with_sliding(slid)
    order = _most_severe_first(frame, labels)
    renumber = np.zeros(len(order) + 1, dtype=np.int32)
    renumber[order + 1] = np.arange(1, len(order) + 1)
    frame = frame.iloc[order].reset_index(drop=True)
    frame["zone_id"] = [f"Z{number:03d}" for number in range(1, len(frame) + 1)]
    ordered = tuple(footprints[i] for i in order)
    return replace(
        base, frame=frame, labels=renumber[labels], footprints=ordered, volumes=volumes.in_order(order)
    )  # fmt: skip


def _most_severe_first(frame: gpd.GeoDataFrame, labels: NDArray[np.int32]) -> Index:
    """By severity, then by volume or what moved, then as they lie."""
    rank = np.array([SEVERITIES.index(s) for s in frame["severity"]], dtype=np.int64)
    inside = np.flatnonzero(labels)
    first = inside[np.unique(labels.ravel()[inside], return_index=True)[1]]
    size = np.maximum(frame["vol_net_m3"].abs(), frame["area_m2"] * frame["motion_m"].fillna(0.0)).to_numpy()
    return np.asarray(np.lexsort((first, -size, rank)))


def _parts(
    found: Zones, verdicts: Sequence[Verdict], moving: Sequence[Slide], grid: Grid
) -> list[tuple[int, ...]]:  # fmt: skip
    """Of each slide the zones of heights that are its parts: what sank at its head, bulged at its toe, or moved on.

    Where they hold together more or less than nothing, material left or came: zones that say so stay zones of their
    own.
    """
    sizes = np.bincount(found.labels.ravel(), minlength=len(verdicts) + 1)[1:]
    reach = max(round(_REACH_M / grid.cell), 1)
    free = np.ones(len(verdicts), dtype=bool)
    parts = []
    for slide in moving:
        near = np.ones(grid.shape, dtype=bool)
        near.ravel()[slide.cells] = False
        near = np.asarray(ndimage.distance_transform_edt(near) <= reach)
        common = np.bincount(found.labels[near], minlength=len(verdicts) + 1)[1:]
        own = np.flatnonzero(free & (common >= _MIN_COMMON_SHARE * sizes) & (sizes > 0))
        net, error = found.volumes.net[own].sum(), np.hypot.reduce(found.volumes.error[own], initial=0.0)
        if abs(net) > _BALANCE_ERRORS * error:
            own = np.array([zone for zone in own if verdicts[int(zone)].movement not in (LOST, GAINED)], dtype=np.int64)
        free[own] = False
        parts.append(tuple(int(zone) for zone in own))
    return parts


def _labels(
    found: Zones, kept: Index, slides: Sequence[Slide], parts: Sequence[tuple[int, ...]]
) -> NDArray[np.int32]:  # fmt: skip
    """The kept zones as 1 and on, then the slides: with their parts, without other zones' cells."""
    number = np.zeros(len(found.frame) + 1, dtype=np.int32)
    number[kept + 1] = np.arange(1, len(kept) + 1)
    for place, of_one in enumerate(parts):
        number[np.array(of_one, dtype=np.int64) + 1] = len(kept) + 1 + place
    labels = number[found.labels]
    flat = labels.ravel()
    for place, slide in enumerate(slides):
        flat[slide.cells[flat[slide.cells] == 0]] = len(kept) + 1 + place
    return labels
