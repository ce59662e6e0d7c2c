"""Pieces of one road joined in the order of its chainage, and what is wrong with a road that cannot be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely import STRtree
from shapely.geometry import LineString, MultiLineString

from ...interface.parameters import RoadParameters
from ..core.arrays import Float
from ..core.errors import InputError
from .chainages import as_text
from .network import Stretch

JOIN_M = 1.0
"""Metres within which the end of one piece is the beginning of the next."""
_LINES_AT_ONCE = 100  # all pairs of 20,000 lines in one place would fill the memory
_JUMP_M = 1.0  # metres of chainage that a rounded field may be off where two pieces join


@dataclass(frozen=True)
class Piece:
    """A line of a road, with the chainages (m) of its first and last corner where they are known, and of all corners
    (``chains``) where M values say them; ``number`` is its feature's in the file, from 1.
    """

    line: LineString
    begin: float | None
    end: float | None
    number: int
    chains: tuple[float, ...] = ()

    @property
    def nodes(self) -> tuple[Float, Float]:
        """Distances from the beginning and chainages there, metres, between which chainage is linear."""
        if self.chains:
            corners = np.asarray(self.line.coords)
            ways = np.linalg.norm(np.diff(corners, axis=0), axis=1)
            return np.concatenate([[0.0], np.cumsum(ways)]), np.array(self.chains)
        return np.array([0.0, self.line.length]), np.array([self.begin or 0.0, self.end or 0.0])

    @property
    def first(self) -> Float:
        return np.asarray(self.line.coords[0])

    @property
    def last(self) -> Float:
        return np.asarray(self.line.coords[-1])


def joined(
    road: tuple[tuple[str, str], Sequence[Piece]], parameters: RoadParameters, name: str, notes: list[str]
) -> list[Stretch]:
    """The connected stretches of a road (its names, and its pieces).

    Raises:
        InputError: it crosses itself, a part of it runs the other way, it has a gap or a branch and no chainages, or
            its chainage jumps where two pieces join and ``parameters.chainage_equations`` does not say that it may.
    """
    (route, carriageway), pieces = road
    called = " ".join(word for word in ("road", route, carriageway) if word)
    subject = f"The {called} of the centreline {name}"
    known = [p.begin is not None for p in pieces]
    if any(known) and not all(known):
        number = pieces[known.index(False)].number
        raise InputError(f"{subject} has chainages, but its line {number} has none; give all of its lines theirs.")
    _refuse_crossing([p.line for p in pieces], subject)
    if not all(known):
        whole = _by_direction(pieces, parameters, subject)
        return [Stretch(route, carriageway, whole.line, np.array([0.0, whole.line.length]), _chains(whole))]
    if parameters.chainage_direction != "drawn" or parameters.chainage_start:
        raise InputError(f"{subject} has chainages of its own; leave --chainage-start and --chainage-direction out.")
    chains = _by_ends([_growing(p) for p in pieces], subject)
    return [_stretch(route, carriageway, chain, parameters, subject, notes) for chain in chains]


def _chains(piece: Piece) -> Float:
    assert piece.begin is not None
    assert piece.end is not None
    return np.array([piece.begin, piece.end])


def _growing(piece: Piece) -> Piece:
    """A piece in the direction of growing chainage; without that of its end, in which it was drawn."""
    assert piece.begin is not None
    if piece.end is None:
        return replace(piece, end=piece.begin + piece.line.length)
    if piece.end < piece.begin:
        return replace(piece, line=piece.line.reverse(), begin=piece.end, end=piece.begin, chains=piece.chains[::-1])
    return piece


def _refuse_crossing(lines: Sequence[LineString], subject: str) -> None:
    """Raise InputError where lines cross themselves or one another elsewhere than at their ends."""
    for line in lines:
        if not line.is_simple:
            place = _place(shapely.node(line), line)
            raise InputError(f"{subject} crosses itself at {place}; divide it there, or correct the line.")
    tree = STRtree(list(lines))
    for predicate in ("crosses", "overlaps", "covers"):
        for start in range(0, len(lines), _LINES_AT_ONCE):
            for i, j in tree.query(list(lines[start : start + _LINES_AT_ONCE]), predicate=predicate).T:
                if start + i != j:
                    met = lines[start + i].intersection(lines[j]).representative_point()
                    raise InputError(
                        f"{subject} crosses itself at x {met.x:.1f}, y {met.y:.1f}; divide it there, or give each "
                        "carriageway its name."
                    )


def _place(noded: MultiLineString, line: LineString) -> str:
    ends = {line.coords[0], line.coords[-1]}
    for part in shapely.get_parts(noded):
        for corner in (part.coords[0], part.coords[-1]):
            if corner not in ends:
                return f"x {corner[0]:.1f}, y {corner[1]:.1f}"
    return f"x {line.coords[0][0]:.1f}, y {line.coords[0][1]:.1f}"


def _by_direction(pieces: Sequence[Piece], parameters: RoadParameters, subject: str) -> Piece:
    """Pieces without chainages as one line, chainages by its length."""
    chains = _by_ends([replace(p, begin=0.0, end=0.0) for p in pieces], subject)
    if len(chains) > 1:
        gap = min(float(np.hypot(*(a[-1].last - b[0].first))) for a in chains for b in chains if a is not b)
        raise InputError(
            f"{subject} has a gap of {gap:.1f} m, so that its chainage is not known beyond; close the gap, give "
            "chainages in the fields chain_from and chain_to, or name its carriageways."
        )
    line = _one_line(chains[0])
    if parameters.chainage_direction == "reversed":
        line = line.reverse()
    start = parameters.chainage_start
    return Piece(line, start, start + line.length, pieces[0].number)


def _first_near(places: Float) -> list[tuple[int, int]]:
    """The first place (n, 2) with another one within ``JOIN_M``, and that one; nothing if there is none."""
    if len(places) < 2:
        return []
    distance, near = cKDTree(places).query(places, k=2)
    found = np.flatnonzero(distance[:, 1] <= JOIN_M)
    if not len(found):
        return []
    first = int(found[0])
    return [(first, int(near[first][near[first] != first][0]))]


def _by_ends(pieces: Sequence[Piece], subject: str) -> list[list[Piece]]:
    """Pieces in chains, each of which begins where the one before ends.

    Raises:
        InputError: two pieces end, or begin, at one place, so that one runs the other way or the road branches.
    """
    firsts, lasts = (np.array([getattr(p, end) for p in pieces]) for end in ("first", "last"))
    for what, places in (("end", lasts), ("begin", firsts)):
        for i, j in _first_near(places):
            raise InputError(
                f"{subject} has two lines, {pieces[i].number} and {pieces[j].number}, that both {what} at x "
                f"{places[i][0]:.1f}, y {places[i][1]:.1f}: one runs the other way, or the road branches; turn it "
                "round, or give it a name of its own."
            )
    begins = cKDTree(firsts).query_ball_point(lasts, JOIN_M)
    follows = {i: min(j for j in near if j != i) for i, near in enumerate(begins) if set(near) - {i}}
    followed = set(follows.values())
    starts = [i for i in range(len(pieces)) if i not in followed] or [0]  # a ring begins at its first piece
    chains = []
    for i in starts:
        chain = dict.fromkeys([i])
        while (after := follows.get(next(reversed(chain)))) is not None and after not in chain:
            chain[after] = None
        chains.append([pieces[j] for j in chain])
    return chains


def _one_line(chain: Sequence[Piece]) -> LineString:
    corners = [np.asarray(p.line.coords) for p in chain]
    return LineString(shapely.remove_repeated_points(LineString(np.concatenate(corners))))


def _stretch(
    route: str,
    carriageway: str,
    chain: Sequence[Piece],
    parameters: RoadParameters,
    subject: str,
    notes: list[str],
) -> Stretch:
    """Pieces with chainages as one stretch; jumps of the chainage between them are equations."""
    along: list[float] = []
    chains: list[float] = []
    at = 0.0
    for i, piece in enumerate(chain):
        if i:
            at += float(np.hypot(*(piece.first - chain[i - 1].last)))
            jump = float(piece.begin or 0.0) - chains[-1]
            if abs(jump) > _JUMP_M:
                behind, ahead = (
                    as_text(m, parameters.chainage_style, parameters.chainage_unit)
                    for m in (chains[-1], float(piece.begin or 0.0))
                )
                if not parameters.chainage_equations:
                    raise InputError(
                        f"{subject} has a {'gap' if jump > 0 else 'step back'} in its chainage, from {behind} to "
                        f"{ahead} where its lines {chain[i - 1].number} and {piece.number} join; correct it, or allow "
                        "equations of chainage with --chainage-equations."
                    )
                notes.append(f"{subject} has an equation of chainage: {behind} back is {ahead} ahead.")
        ways, own = piece.nodes
        along += [at + float(way) for way in ways]
        chains += [float(chain) for chain in own]
        at += piece.line.length
    return Stretch(route, carriageway, _one_line(chain), np.array(along), np.array(chains))
