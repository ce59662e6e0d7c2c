"""Zones followed through the surveys of a series: ids that stay, splits and merges by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.arrays import Index

Labels = NDArray[np.int32]
Alike = Callable[[int, Index, int, Index], bool]
"""Whether cells (flat indices) in one survey move as others do in another: survey, cells, survey, cells."""

_MIN_SHARED_SHARE = 0.1  # of the smaller one's cells: less in common is a touch, not the same zone
_MIN_SEPARATE_SHARE = 0.25  # of the zone's cells: a smaller part that came apart stays part of it


@dataclass(frozen=True)
class Sighting:
    """A zone in one survey: its significant ``cells`` (flat indices) and what happened to it.

    ``event`` is new, continued, split (other zones came out of it, or it came out of another) or merged (others went
    into it); ``others`` are their ids.
    """

    epoch: int
    cells: Index
    event: str
    others: tuple[str, ...] = ()


@dataclass(frozen=True)
class Track:
    """A zone through time.

    ``footprint`` (flat indices, sorted) is the union of its significant cells over all surveys, without those that went
    to another zone by a split. ``parent`` is the zone that it came out of; ``merged_into`` the one that it went into,
    in which it lives on.
    """

    zone_id: str
    sign: int
    sightings: tuple[Sighting, ...]
    footprint: Index
    parent: str
    merged_into: str


@dataclass
class _Open:
    """A track while it grows; ``number`` from 1."""

    number: int
    sign: int
    cells: Index
    parent: str = ""
    merged_into: str = ""
    sightings: list[Sighting] = field(default_factory=list)

    @property
    def zone_id(self) -> str:
        return f"S{self.number:03d}"


def track_zones(
    groups: Sequence[tuple[int, Labels, NDArray[np.int8]]], reach: int, alike: Alike | None = None
) -> tuple[Track, ...]:
    """Follow groups of significant cells from survey to survey, those of lowering and of raising apart.

    A group belongs to the zone whose footprint so far, widened by ``reach`` cells, holds a tenth or more of the smaller
    of the two. A group that holds the largest part of several zones merges them: the one with most cells in common
    keeps its id. Of several groups in one zone the largest keeps the id; another that holds a quarter of the
    zone's footprint is split off, a smaller one stays part of it. Zones are numbered as they appear, so a later
    survey changes no earlier id.

    Args:
        groups: for each survey its index, the labels (rows, columns; 0 for none) and the sign of each cell's change.
        alike: where given, a group that moves otherwise than a zone belongs to it only by cells in the footprint
            itself, does not merge it with another, and is split off however small it is.
    """
    tracks: list[_Open] = []
    if not groups:
        return ()
    shape = groups[0][1].shape
    owner = {sign: np.zeros(shape, dtype=np.int32) for sign in (-1, 1)}
    for epoch, labels, signs in groups:
        for sign in (-1, 1):
            part = np.where(signs == sign, labels, 0)
            _follow(epoch, sign, part, owner[sign], tracks, reach, alike or _always)
    for t in tracks:
        if not t.merged_into:  # a cell that changed hands belongs to the last one only
            t.cells = np.flatnonzero(owner[t.sign].ravel() == t.number)
    return tuple(Track(t.zone_id, t.sign, tuple(t.sightings), t.cells, t.parent, t.merged_into) for t in tracks)


def _always(survey: int, cells: Index, other: int, others: Index) -> bool:
    return True


def _follow(
    epoch: int, sign: int, labels: Labels, owner: Labels, tracks: list[_Open], reach: int, alike: Alike
) -> None:
    flat = labels.ravel()
    inside = np.flatnonzero(flat)
    if not len(inside):
        return
    order = inside[np.argsort(flat[inside], kind="stable")]
    numbers, starts = np.unique(flat[order], return_index=True)
    cells = dict(zip(numbers.tolist(), np.split(order, starts[1:]), strict=True))

    def as_before(group: int, track: int) -> bool:
        last = tracks[track - 1].sightings[-1]
        return alike(epoch, cells[group], last.epoch, last.cells)

    shared = _overlaps(flat, owner, cells, tracks, reach, as_before)
    source: int | None
    heirs: dict[int, int] = {}  # track: the group with most of it
    for (group, track), count in shared.items():
        known = heirs.get(track)
        if known is None or count > shared[known, track]:
            heirs[track] = group
    parts: dict[int, list[int]] = {}
    fresh: list[tuple[int, int | None]] = []  # groups that begin a zone, and the one they came out of
    for group in cells:
        claims = [t for t, g in heirs.items() if g == group]
        touched = [t for g, t in shared if g == group]
        if claims:
            keeper = max(claims, key=lambda t: (shared[group, t], -t))
            merged = [t for t in claims if t != keeper and as_before(group, t)]
            _continue(tracks[keeper - 1], [tracks[t - 1] for t in merged], epoch, cells[group])
        elif touched:
            source = max(touched, key=lambda t: (shared[group, t], -t))
            large = len(cells[group]) >= _MIN_SEPARATE_SHARE * len(tracks[source - 1].cells)
            if large or not alike(epoch, cells[group], epoch, cells[heirs[source]]):
                fresh.append((group, source))
            else:
                parts.setdefault(source, []).append(group)
        else:
            fresh.append((group, None))
    for number, groups in parts.items():
        _add_parts(_living(tracks, number), epoch, [cells[g] for g in groups])
    for group, source in fresh:
        parent = None if source is None else _living(tracks, source)
        tracks.append(_begin(len(tracks) + 1, sign, epoch, cells[group], parent))
    owner[:] = 0
    for one in tracks:
        if one.sign == sign and not one.merged_into:
            owner.ravel()[one.cells] = one.number


def _overlaps(
    flat: Labels,
    owner: Labels,
    cells: dict[int, Index],
    tracks: list[_Open],
    reach: int,
    alike: Callable[[int, int], bool],
) -> dict[tuple[int, int], int]:
    """Cells that a group and a zone have in common, where they are enough; those of its reach only of the ``alike``."""
    wide = owner
    if reach:
        spread = ndimage.maximum_filter(owner, size=2 * reach + 1)
        wide = np.where(owner > 0, owner, spread)
    both = np.flatnonzero((flat > 0) & (wide.ravel() > 0))
    pairs, counts = np.unique(np.stack([flat[both], wide.ravel()[both]]), axis=1, return_counts=True)
    shared = {}
    for (group, track), count in zip(pairs.T.tolist(), counts.tolist(), strict=True):
        if reach and not alike(group, track):
            count = int(np.count_nonzero(owner.ravel()[cells[group]] == track))
        if count and count >= _MIN_SHARED_SHARE * min(len(cells[group]), len(tracks[track - 1].cells)):
            shared[group, track] = count
    return shared


def _living(tracks: list[_Open], number: int) -> _Open:
    """The zone in which zone ``number`` lives on."""
    track = tracks[number - 1]
    while track.merged_into:
        track = tracks[int(track.merged_into[1:]) - 1]
    return track


def _continue(track: _Open, merged: list[_Open], epoch: int, cells: Index) -> None:
    for other in merged:
        other.merged_into = track.zone_id
        track.cells = np.union1d(track.cells, other.cells)
    track.cells = np.union1d(track.cells, cells)
    event = "merged" if merged else "continued"
    track.sightings.append(Sighting(epoch, cells, event, tuple(o.zone_id for o in merged)))


def _add_parts(track: _Open, epoch: int, parts: list[Index]) -> None:
    own = track.sightings[-1]
    track.sightings[-1] = Sighting(epoch, np.union1d(own.cells, np.concatenate(parts)), own.event, own.others)
    track.cells = np.union1d(track.cells, track.sightings[-1].cells)


def _begin(number: int, sign: int, epoch: int, cells: Index, parent: _Open | None) -> _Open:
    track = _Open(number, sign, np.sort(cells))
    if parent is None:
        track.sightings.append(Sighting(epoch, cells, "new"))
        return track
    track.parent = parent.zone_id
    track.sightings.append(Sighting(epoch, cells, "split", (parent.zone_id,)))
    parent.cells = np.setdiff1d(parent.cells, cells)
    own = parent.sightings[-1]
    if own.epoch == epoch:
        parent.sightings[-1] = Sighting(epoch, own.cells, "split", (*own.others, track.zone_id))
    return track
