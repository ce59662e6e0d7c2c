"""Motion along the surface: vectors and zones on simulated and real ground, compared with what other measures see.

Simulated: two scans of the demo's slope under 70 % vegetation, their ground extracted and thinned to 70 points a m² of
map; of the later one an ellipse of 12 m along the dip and 8 m across, with a soft edge, is moved down the dip.
Real: the ground of two random halves of a dense cloud, of which all or nothing is moved; they share their position and
their strips, so that this is what the relief allows, and no accuracy in the field. Bare: that relief without plants,
for many still maps at little cost and for a denser cloud; and smooth ground on which objects come and go.
Seeds from ``FIRST_SEED`` on; those before are for development only. Each case is kept (``kept_cases``).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...engine.core.arrays import Float
from ...engine.displacement.chance import beyond_chance
from ...engine.displacement.displacement import Displacement, measure_displacement
from ...engine.displacement.facets import find_facets
from ...engine.displacement.registered import Registered
from ...engine.displacement.vectors import Vectors
from ...interface.parameters import DisplacementParameters, SurveyParameters
from ...simulation.surveys.survey import simulate_pair
from .chain import ground_of
from .displacement_peers import motion_by_others, seen_by_others
from .displacement_real import REAL, real_pair
from .displacement_rows import OURS, REPORTED, Windows, beside_rows, moving_rows, other_rows, still_rows, window_rows
from .displacement_scenes import bare_pair, changing_objects
from .kept_cases import KeptCases
from .table import Row, say

FIRST_SEED, PAIRS, BARE_MAPS, DENSE_MAPS, OBJECT_MAPS = 9, 8, 32, 2, 4
MOTIONS_M = (0.05, 0.1, 0.2)
POINTS_PER_M2, DENSE_POINTS_PER_M2 = 70.0, 200.0
_AREA_M2 = 889.0  # of the slope on the map
_APART_M = 6.0  # windows that are compared with others
_HALF_AXES_M, _CORE, _INNER, _SOFT = (6.0, 4.0), 0.35, 0.6, 0.75
SIZES = (5.0, 8.0)
_TARGETS_MM = {5.0: (20.0, 27.0), 8.0: (12.0, 15.0)}
_DENSE_TARGET_MM = (9.0, 12.0)


def simulated(seed: int) -> tuple[Float, Float]:
    """Ground of two scans in one frame, thinned to ``POINTS_PER_M2``."""
    parameters = SurveyParameters(seed=seed, points=480_000, length=40.0, height=18.0, offset=0.0)
    pair = simulate_pair(parameters, changes=())
    first, second = (ground_of(cloud, pair).xyz for cloud in (pair.first, pair.second))
    rng = np.random.default_rng(seed)
    clouds = (first, pair.transform.apply(second))
    keep = int(POINTS_PER_M2 * _AREA_M2)
    a, b = (xyz[np.sort(rng.permutation(len(xyz))[:keep])] for xyz in clouds)
    return a, b


def radius_in_ellipse(places: Float, first: Float) -> tuple[Float, Float]:
    """(n,) distance from the ellipse's middle in its half axes, and the direction of the dip (3,)."""
    frame = find_facets(first).frames[0]
    flat = frame.to_plane(places)
    return np.hypot(flat[:, 0] / _HALF_AXES_M[0], flat[:, 1] / _HALF_AXES_M[1]), frame.axes[0]


def moved(first: Float, later: Float, motion: float) -> Float:
    """``later`` (n, 3) with the ellipse moved down the dip by ``motion`` metres, less from its soft edge on."""
    radius, dip = radius_in_ellipse(later, first)
    share = np.clip((1 - radius) / (1 - _SOFT), 0.0, 1.0)
    return later + (motion * share * share * (3 - 2 * share))[:, None] * dip


def measured(first: Float, later: Float) -> Displacement:
    """With the default settings, as if the registration had no error."""
    return measure_displacement(first, later, DisplacementParameters(), Registered.unknown())


def compared(vectors: Vectors, motion: Float) -> Windows:
    """The windows' errors against a motion (3,) of all ground."""
    off = replace(vectors, motion=vectors.motion - motion)
    use = vectors.measured
    stated = np.sqrt(np.einsum("nii->ni", off.in_plane_covariance[use][:, :2, :2]))
    return Windows(off.in_plane[use][:, 1::-1], stated[:, ::-1], off.statistic[use], float(use.mean()))


def rows(store: Path | None = None) -> list[Row]:
    """The figures with their targets; cases that ``store`` holds are not measured again."""
    cases = KeptCases(store and store.with_suffix(".jsonl"))
    seeds = range(FIRST_SEED, FIRST_SEED + PAIRS)
    pairs = [_said(cases, f"pair {seed}", lambda seed=seed: pair_case(seed)) for seed in seeds]
    bare = _bare(cases, POINTS_PER_M2, BARE_MAPS)
    zones = [case["still"]["zones"] for case in [*pairs, *bare]]
    dense = _bare(cases, DENSE_POINTS_PER_M2, DENSE_MAPS)
    found = [*still_rows(pairs, zones, _TARGETS_MM), *moving_rows(pairs), *other_rows(pairs)]
    found += beside_rows("simulated, nothing moved", [pair["still"]["beside"] for pair in pairs])
    for motion in map(str, MOTIONS_M):
        name = f"simulated, {100 * float(motion):.0f} cm down the dip, all windows"
        found += beside_rows(name, [pair["moved"][motion]["beside"] for pair in pairs])
    found += beside_rows("bare relief, nothing moved", [m["still"]["beside"] for m in bare])
    for density, maps, target in ((POINTS_PER_M2, bare, None), (DENSE_POINTS_PER_M2, dense, _DENSE_TARGET_MM)):
        name = f"bare relief, {density:g} points/m²"
        for size in (REPORTED, *SIZES):
            found += window_rows(name, size, [m["still"] for m in maps], target if size == SIZES[0] else None)
    return [*found, *_object_rows(cases), *_real_rows(cases)]


def _said(cases: KeptCases, name: str, measure: Any) -> Any:
    found = cases.get(name, measure)
    say(name)
    return found


def pair_case(seed: int) -> dict[str, Any]:
    """A simulated pair: still, with the ellipse moved by each motion, and as others see it."""
    first, later = simulated(seed)
    found: dict[str, Any] = {"still": still_case(first, later, np.zeros(3), others=True), "moved": {}}
    for motion in MOTIONS_M:
        found["moved"][str(motion)] = _moved_case(first, moved(first, later, motion), motion)
    found["others"] = seen_by_others(first, moved(first, later, MOTIONS_M[1]), radius_in_ellipse, _CORE)
    return found


def still_case(first: Float, later: Float, motion: Float, *, others: bool = False) -> dict[str, Any]:
    """The windows where all ground has moved by ``motion`` (3,), as reported and by width, and the number of zones."""
    began = time.process_time()
    found = measured(first, later)
    taken = time.process_time() - began
    by_name = {REPORTED: found.vectors} | {f"{s:g}": v for s, v in zip(SIZES, found.by_width, strict=True)}
    windows = {name: compared(vectors, motion).as_lists() for name, vectors in by_name.items()}
    reported = [
        int(np.count_nonzero(part)) for part in (found.significant, beyond_chance(found), found.vectors.measured)
    ]
    kept = {"windows": windows, "zones": len(found.zones), "reported": reported, "seconds": taken / _AREA_M2 * 1000}
    return kept | ({"beside": beside(first, later, found, np.tile(motion, (len(found.cell), 1)))} if others else {})


def beside(first: Float, later: Float, found: Displacement, truth: Float) -> dict[str, list[list[float]]]:
    """Errors (k, 2) along the dip and across it (m) of each method in the same windows, one each ``_APART_M``.

    Args:
        truth: (n, 3) motion at the windows' middles, metres.
    """
    vectors = found.vectors
    square = np.floor(vectors.places[:, :2] / _APART_M).astype(np.int64)
    measured_ones = np.flatnonzero(vectors.measured & (found.facet == 0))
    use = measured_ones[np.unique(square[measured_ones], axis=0, return_index=True)[1]]
    axes = vectors.axes[use, :2]
    motions = {OURS: vectors.in_plane[use, :2]} | motion_by_others(first, later, vectors.places[use])
    wanted = np.einsum("nij,nj->ni", axes, truth[use])
    return {name: np.round(motion - wanted, 6).tolist() for name, motion in motions.items()}


def _moved_case(first: Float, later: Float, motion: float) -> dict[str, Any]:
    found = measured(first, later)
    places = found.vectors.places
    radius, dip = radius_in_ellipse(places, first)
    hits = [zone for zone in found.zones if (radius[zone.windows] < _INNER).any()]
    core = found.vectors.measured & (radius < _CORE) & found.significant
    off = replace(found.vectors, motion=found.vectors.motion - motion * dip).in_plane[core, :2]
    return {
        "zones": len(hits),
        "bias": float(hits[0].in_plane[0] / motion - 1) if hits else None,
        "core": np.hypot(*off.T).tolist(),
        "shown": {
            f"{s:g}": v.significant(0.99)[radius < _INNER].tolist() for s, v in zip(SIZES, found.by_width, strict=True)
        },
        "beside": beside(first, later, found, moved(first, places, motion) - places),
    }


def _bare(cases: KeptCases, points_per_m2: float, count: int) -> list[dict[str, Any]]:
    """Bare still maps, with the windows of both widths and the number of zones."""

    def measure(seed: int) -> dict[str, Any]:
        return {"still": still_case(*bare_pair(seed, points_per_m2), np.zeros(3), others=True)}

    seeds = range(FIRST_SEED, FIRST_SEED + count)
    return [
        _said(cases, f"bare map {seed}, {points_per_m2:g} points/m²", lambda seed=seed: measure(seed)) for seed in seeds
    ]


def _object_rows(cases: KeptCases) -> Iterator[Row]:
    def measure(seed: int) -> list[int]:
        found = measured(*changing_objects(seed, POINTS_PER_M2))
        return [int(found.significant.sum()), len(found.significant), len(found.zones)]

    seeds = range(FIRST_SEED, FIRST_SEED + OBJECT_MAPS)
    maps = [_said(cases, f"objects {seed}", lambda seed=seed: measure(seed)) for seed in seeds]
    claims, windows, zones = np.sum(maps, axis=0).tolist()
    yield Row("boxes and bowls that come and go: windows that claim a vector", f"{claims} of {windows}", "0",
              f"{zones} zones", claims == 0)  # fmt: skip


def _real_rows(cases: KeptCases) -> Iterator[Row]:
    for ground in REAL:
        if not ground.path.exists():
            continue

        def measure(number: int, ground: Any = ground) -> dict[str, Any]:
            pair = real_pair(ground, number)
            found = still_case(pair.first, pair.later, pair.motion, others=ground.extract)
            return found | {"points_per_m2": pair.points_per_m2, "motion": float(np.linalg.norm(pair.motion))}

        maps = [
            _said(cases, f"{ground.name} {number}", lambda number=number, measure=measure: measure(number))
            for number in range(ground.maps)
        ]
        points = float(np.median([m["points_per_m2"] for m in maps]))
        name = f"{ground.name}, {points:.0f} ground points/m², moved by 0 to 20 cm, {len(maps)} times"
        for size in (REPORTED, *SIZES):
            yield from window_rows(name, size, maps, None)
        if ground.extract:
            yield from beside_rows(name, [m["beside"] for m in maps])
        zones = sum(m["zones"] > 0 for m in maps if not m["motion"])
        still = sum(not m["motion"] for m in maps)
        yield Row(f"{ground.name}: still maps with a zone", f"{zones} of {still}", "0", "", zones == 0)
