"""Surveys of grown and of mown grass on a slope that has not moved: what the chain makes of the plants.

Each pair goes through ground extraction, registration, differencing and zones at the default settings, with what the
ground says of plants. Grass covers a part of the slope next to bare ground, all of it above a bare road, or all of it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...engine.core.arrays import Float
from ...engine.ground.filtering import dominant_plane
from ...interface.parameters import ChangeParameters, GroundParameters, RegistrationParameters, SurveyParameters
from ...simulation.surveys.survey import SimulatedPair, simulate_pair
from .chain import changed, registered
from .table import Row, say

PAIRS = 20
POINTS = 170_000
"""Of an epoch: about 400 returns a m² of the slope."""
LENGTH, HEIGHT, ANGLES = 20.0, 10.0, (30.0, 35.0, 39.0, 45.0)
PLACES = {
    "grass next to a bare end": (0.7, "left", 0.0),
    "patches of grass": (0.6, "patches", 0.0),
    "grass above a bare road": (1.0, "left", 4.0),
    "half grass, half bare": (0.5, "left", 0.0),
    "grass all over": (1.0, "left", 0.0),
}
"""Share of grass, its layout, and how far the region reaches beyond the slope (the road lies below), m."""
MOWN = ("later", "first")
WITHOUT = {
    "cloth alone, plants unknown": (GroundParameters(refine=False), "default"),
    "published settings": (GroundParameters.build(profile="paper"), "paper"),
}
"""Other ways for comparison: ground parameters, and the profile of the rest."""
MAX_HEIGHT_ERROR_M = 0.01
SHARE = (0.03, 0.07)


@dataclass(frozen=True)
class Unmoved:
    """What came of a pair without movement.

    Attributes:
        place: of ``PLACES``.
        zones: number of zones, all false; ``zone_area`` of them together, m².
        beyond: share of the compared cells beyond their level of 95 %.
        reported: share of them beyond it that the plants do not explain.
        height_error: of the surface at a place after registration, mean over the ground, m.
        slide: how far the ground is off along the surface, root mean square, m.
        stated: standard error that the registration gives for a height, m.
        level: median level of detection, m.
        bare_only: whether bare ground alone was registered.
    """

    place: str
    zones: int
    zone_area: float
    beyond: float
    reported: float
    height_error: float
    slide: float
    stated: float
    level: float
    bare_only: bool


def place_of(number: int) -> str:
    """Which of ``PLACES`` pair ``number`` is of: they go round."""
    return tuple(PLACES)[number % len(PLACES)]


def simulated(number: int) -> SimulatedPair:
    """Pair ``number``: grown in one survey and mown in the other, nothing moved."""
    share, layout, beyond = PLACES[place_of(number)]
    turn = number // len(PLACES)
    parameters = SurveyParameters(
        seed=900 + number,
        points=POINTS,
        length=LENGTH,
        height=HEIGHT,
        angle=ANGLES[turn % len(ANGLES)],
        vegetation=0.0,
        amplitude=0.0,
        grass=share,
        layout=layout,
        mown=MOWN[number % len(MOWN)],
    )
    return simulate_pair(parameters, roi_buffer=beyond)


def judged(
    pair: SimulatedPair, place: str, ground: GroundParameters | None = None, profile: str = "default"
) -> Unmoved:
    """A pair through the chain, against the truth that nothing moved."""
    found, first, second = registered(pair, ground, RegistrationParameters.build(profile=profile))
    change, zones = changed(found, first, second, ChangeParameters.build(profile=profile))
    beyond = np.abs(change.dz[change.valid]) > change.level[change.valid]
    explained = np.zeros(len(beyond), bool) if change.explained is None else change.explained[change.valid]
    height_error, slide = misplaced(pair, second.xyz, found.transform.inverse().apply(second.xyz))
    return Unmoved(
        place=place,
        zones=len(zones.frame),
        zone_area=float(zones.frame["area_m2"].sum()),
        beyond=float(np.mean(beyond)),
        reported=float(np.mean(beyond & ~explained)),
        height_error=height_error,
        slide=slide,
        stated=found.registration_error,
        level=change.median_level,
        bare_only=found.plants is not None and found.plants.bare_only,
    )


def misplaced(pair: SimulatedPair, moved: Float, surveyed: Float) -> tuple[float, float]:
    """Mean error of the surface's height, and root mean square of the error along it, m, of registered points (n, 3).

    Args:
        surveyed: the same points (n, 3) before registration.
    """
    normal = dominant_plane(moved).normal
    off = moved - pair.transform.apply(surveyed)
    across = off @ normal
    along = off - across[:, None] * normal
    return float(across.mean() / normal[2]), float(np.sqrt(np.mean(np.sum(along**2, axis=1))))


def results(count: int = PAIRS) -> tuple[list[Unmoved], dict[str, Unmoved]]:
    """All pairs one after the other, and the first one in each of the ways ``WITHOUT``."""
    found: list[Unmoved] = []
    others: dict[str, Unmoved] = {}
    for number in range(count):
        pair = simulated(number)
        if number == 0:
            others = {name: judged(pair, place_of(0), *how) for name, how in WITHOUT.items()}
            say(f"pair 1 otherwise: {others}")
        found.append(judged(pair, place_of(number)))
        say(f"pair {number + 1} of {count}: {found[-1]}")
    return found, others


def rows() -> list[Row]:
    """False zones, cells beyond their level, and the registration's errors."""
    found, others = results()
    first = found[0]
    zones = sum(f.zones for f in found)
    share = float(np.mean([f.beyond for f in found]))
    lines = [
        Row(
            f"false zones, grass grown and mown, nothing moved ({len(found)} pairs)",
            f"{zones}{_where(found)}",
            "0",
            f"the first pair: {first.zones}"
            + "".join(f"; {name} {o.zones} ({o.zone_area:.0f} m²)" for name, o in others.items()),
            zones == 0,
        ),
        Row(
            "compared cells beyond their level of 95 %, mean of the pairs",
            f"{100 * share:.1f} % ({100 * min(f.beyond for f in found):.1f} to "
            f"{100 * max(f.beyond for f in found):.1f})",
            f"{100 * SHARE[0]:g} to {100 * SHARE[1]:g} %",
            f"the first pair: {100 * first.beyond:.1f} %"
            + "".join(f"; {name} {100 * o.beyond:.1f} %" for name, o in others.items()),
            bool(SHARE[0] <= share <= SHARE[1]),
        ),
        Row(
            "of which the plants do not explain",
            f"{100 * float(np.mean([f.reported for f in found])):.1f} %",
        ),
    ]
    for place in PLACES:
        own = [f for f in found if f.place == place]
        if own:
            lines.append(_registration_row(place, own, others if place == place_of(0) else {}))
    return lines


def _registration_row(place: str, found: Sequence[Unmoved], others: dict[str, Unmoved]) -> Row:
    errors = np.array([f.height_error for f in found])
    worst = float(errors[np.abs(errors).argmax()])
    return Row(
        f"registration, {place}: error of heights",
        f"{1000 * float(np.abs(errors).mean()):.1f} mm, worst {1000 * worst:+.1f} (stated "
        f"{1000 * float(np.mean([f.stated for f in found])):.1f}); along the surface up to "
        f"{1000 * max(f.slide for f in found):.0f} mm; by bare ground alone {sum(f.bare_only for f in found)} of "
        f"{len(found)}; level {100 * float(np.mean([f.level for f in found])):.1f} cm; cells beyond it "
        f"{100 * float(np.mean([f.beyond for f in found])):.1f} %",
        f"{1000 * MAX_HEIGHT_ERROR_M:g} mm",
        "; ".join(f"{name} {1000 * o.height_error:+.1f} mm" for name, o in others.items()),
        abs(worst) <= MAX_HEIGHT_ERROR_M,
    )


def _where(found: Sequence[Unmoved]) -> str:
    """The places of false zones, in brackets."""
    places = Counter[str]()
    for one in found:
        places[one.place] += one.zones
    area = sum(f.zone_area for f in found)
    some = ", ".join(f"{place} {zones}" for place, zones in places.items() if zones)
    return f" ({some}; {area:.1f} m² together)" if some else ""
