"""Motion along the surface: vectors and zones on simulated and real ground, compared with what other measures see.

Simulated: two scans of the demo's slope under 70 % vegetation, their ground extracted and thinned to 70 points a m² of
map; of the later one an ellipse of 12 m along the dip and 8 m across, with a soft edge, is moved down the dip.
Real: the ground of two random halves of a dense cloud, of which all or nothing is moved; they share their position and
their strips, so that this is what the relief allows, and no accuracy in the field. Bare: that relief without plants,
for many still maps at little cost and for a denser cloud; and smooth ground on which objects come and go.
Seeds from ``FIRST_SEED`` on; those before are for development only.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..engine.core.arrays import Bool, Float
from ..engine.displacement.displacement import Displacement, measure_displacement
from ..engine.displacement.facets import find_facets
from ..engine.displacement.registered import Registered
from ..engine.displacement.vectors import Vectors, threshold
from ..engine.ground.filtering import known_ground
from ..interface.parameters import DisplacementParameters, SurveyParameters
from ..simulation.surveys.survey import simulate_pair
from .chain import ground_of
from .displacement_peers import seen_by_others
from .displacement_scenes import bare_pair, changing_objects
from .real_data import DENSE_HALVES, dense_cloud, split
from .table import Row, say

FIRST_SEED, PAIRS, BARE_MAPS, DENSE_MAPS, OBJECT_MAPS = 9, 8, 32, 2, 4
MOTIONS_M = (0.05, 0.1, 0.2)
POINTS_PER_M2, DENSE_POINTS_PER_M2 = 70.0, 200.0
_AREA_M2 = 889.0  # of the slope on the map
_HALF_AXES_M, _CORE, _INNER, _SOFT = (6.0, 4.0), 0.35, 0.6, 0.75
SIZES = (5.0, 8.0)
_TARGETS_MM = {5.0: (20.0, 27.0), 8.0: (12.0, 15.0)}
_DENSE_TARGET_MM = (9.0, 12.0)
_REAL_SHIFTS_M = (0.0, 0.0, 0.05, 0.2)


@dataclass(frozen=True)
class Windows:
    """Windows of one width on one map: ``error`` (n, 2) across and along the dip, ``stated`` (n, 2) standard errors,
    ``statistic`` (n,) of the motion or its error, ``usable`` the share of all windows.
    """

    error: Float
    stated: Float
    statistic: Float
    usable: float


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


@dataclass
class _Tally:
    """What the simulated pairs gave."""

    still: dict[float, list[Windows]]
    false_zones: list[int]
    seconds: list[float]
    detected: dict[tuple[float, float], list[Bool]]
    found: dict[float, list[bool]]
    bias: dict[float, list[float]]
    worst: list[float]
    others: list[dict[str, float]]


def rows() -> list[Row]:
    """The figures with their targets."""
    tally = _Tally({s: [] for s in SIZES}, [], [], {}, {m: [] for m in MOTIONS_M}, {m: [] for m in MOTIONS_M}, [], [])
    for seed in range(FIRST_SEED, FIRST_SEED + PAIRS):
        first, later = simulated(seed)
        _still(tally, first, later)
        for motion in MOTIONS_M:
            _moving(tally, first, moved(first, later, motion), motion)
        tally.others.append(seen_by_others(first, moved(first, later, MOTIONS_M[1]), radius_in_ellipse, _CORE))
        say(f"pair {seed}: {tally.false_zones[-1]} false zones, {tally.seconds[-1]:.1f} s per 1,000 m²")
    bare = _bare(POINTS_PER_M2, BARE_MAPS)
    tally.false_zones.extend(zones for _, zones in bare)
    simulated_rows = [*_still_rows(tally), *_moving_rows(tally), *_other_rows(tally)]
    return [*simulated_rows, *_bare_rows(bare), *_object_rows(), *_real_rows()]


def _bare(points_per_m2: float, count: int) -> list[tuple[dict[float, Windows], int]]:
    """Windows of both widths and the number of zones of bare still maps."""
    found = []
    for seed in range(FIRST_SEED, FIRST_SEED + count):
        map_ = measured(*bare_pair(seed, points_per_m2))
        sizes = {s: compared(v, np.zeros(3)) for s, v in zip(SIZES, map_.by_width, strict=True)}
        found.append((sizes, len(map_.zones)))
        say(f"bare map {seed}: {len(map_.zones)} false zones")
    return found


def _bare_rows(bare: list[tuple[dict[float, Windows], int]]) -> Iterator[Row]:
    dense = _bare(DENSE_POINTS_PER_M2, DENSE_MAPS)
    for density, maps, target in ((POINTS_PER_M2, bare, None), (DENSE_POINTS_PER_M2, dense, _DENSE_TARGET_MM)):
        for size in SIZES:
            name = f"bare relief, {density:g} points/m²"
            yield from _window_rows(name, size, [m[size] for m, _ in maps], target if size == SIZES[0] else None)


def _object_rows() -> Iterator[Row]:
    claims = windows = 0
    for seed in range(FIRST_SEED, FIRST_SEED + OBJECT_MAPS):
        found = measured(*changing_objects(seed, POINTS_PER_M2))
        claims, windows = claims + int(found.significant.sum()), windows + len(found.significant)
    yield Row("boxes and bowls that come and go: windows that claim a vector", f"{claims} of {windows}", "0", "",
              claims == 0)  # fmt: skip


def _still(tally: _Tally, first: Float, later: Float) -> None:
    began = time.process_time()
    found = measured(first, later)
    tally.seconds.append((time.process_time() - began) / _AREA_M2 * 1000)
    tally.false_zones.append(len(found.zones))
    for size, vectors in zip(SIZES, found.by_width, strict=True):
        tally.still[size].append(compared(vectors, np.zeros(3)))


def _moving(tally: _Tally, first: Float, later: Float, motion: float) -> None:
    found = measured(first, later)
    radius, dip = radius_in_ellipse(found.vectors.places, first)
    hits = [zone for zone in found.zones if (radius[zone.windows] < _INNER).any()]
    tally.found[motion].append(bool(hits))
    if hits:
        tally.bias[motion].append(float(hits[0].in_plane[0] / motion - 1))
    core = found.vectors.measured & (radius < _CORE) & found.significant
    off = replace(found.vectors, motion=found.vectors.motion - motion * dip).in_plane[core, :2]
    tally.worst.append(float(np.hypot(*off.T).max()) if len(off) else 0.0)
    for size, vectors in zip(SIZES, found.by_width, strict=True):
        tally.detected.setdefault((size, motion), []).append(vectors.significant(0.99)[radius < _INNER])


def _window_rows(
    name: str, size: float, windows: Sequence[Windows], targets: tuple[float, float] | None
) -> Iterator[Row]:
    error, stated = (np.concatenate([getattr(w, key) for w in windows]) for key in ("error", "stated"))
    statistic = np.concatenate([w.statistic for w in windows])
    rms = 1000 * np.sqrt((error**2).mean(axis=0))
    within = 100 * (np.abs(error) < 2 * stated).mean(axis=0)
    false = 100 * float((statistic > threshold(0.99)).mean())
    usable = 100 * float(np.mean([w.usable for w in windows]))
    yield Row(
        f"{name}, windows of {size:g} m ({len(error)}): rms error across / along the dip",
        f"{rms[0]:.1f} / {rms[1]:.1f} mm",
        f"≤ {targets[0]:g} / {targets[1]:g} mm" if targets else "",
        f"{usable:.0f} % of all windows have a vector",
        bool((rms <= targets).all()) if targets else None,
    )
    yield Row(
        "the same: within two standard errors, across / along",
        f"{within[0]:.1f} / {within[1]:.1f} %",
        "93 to 97 %",
        "",
        bool((within >= 93).all()),
    )
    yield Row("the same: windows falsely moving at nominal 1 %", f"{false:.2f} %", "≤ 1.5 %", "", false <= 1.5)


def _still_rows(tally: _Tally) -> Iterator[Row]:
    for size in SIZES:
        yield from _window_rows("simulated, nothing moved", size, tally.still[size], _TARGETS_MM[size])
    maps = sum(count > 0 for count in tally.false_zones)
    yield Row(
        "still maps with a zone",
        f"{maps} of {len(tally.false_zones)}",
        "≤ 5 %",
        "",
        maps <= 0.05 * len(tally.false_zones),
    )
    seconds = float(np.median(tally.seconds))
    yield Row("processor seconds per 1,000 m², both widths", f"{seconds:.1f} s", "≤ 3 s", "", seconds <= 3.0)


def _moving_rows(tally: _Tally) -> Iterator[Row]:
    targets = {(8.0, 0.1): 95.0, (8.0, 0.05): 60.0}
    for (size, motion), hits in sorted(tally.detected.items()):
        share = 100 * float(np.concatenate(hits).mean())
        target = targets.get((size, motion))
        yield Row(
            f"{100 * motion:.0f} cm down the dip: windows of {size:g} m that show it",
            f"{share:.0f} %",
            f"≥ {target:g} %" if target else "",
            "refused windows count as missed",
            share >= target if target else None,
        )
    for motion, found in tally.found.items():
        least = {0.05: 0.5, 0.1: 1.0}.get(motion)
        yield Row(
            f"{100 * motion:.0f} cm: zone found", f"{sum(found)} of {len(found)}",
            "" if least is None else f"≥ {100 * least:.0f} %", "",
            None if least is None else sum(found) >= least * len(found),
        )  # fmt: skip
        if tally.bias[motion]:
            bias = 100 * float(np.mean(tally.bias[motion]))
            yield Row(
                f"{100 * motion:.0f} cm: bias of the zones' motion along the dip", f"{bias:+.1f} %",
                "" if motion < 0.1 else "≤ 5 %", "", None if motion < 0.1 else abs(bias) <= 5,
            )  # fmt: skip
    worst = max(tally.worst)
    yield Row("largest error of a vector in a zone's core", f"{worst:.3f} m", "≤ 0.1 m", "", worst <= 0.1)


def _other_rows(tally: _Tally) -> Iterator[Row]:
    for name in tally.others[0]:
        values = [other[name] for other in tally.others]
        yield Row(f"10 cm down the dip as others see it: {name}", f"{100 * float(np.nanmean(values)):+.1f} cm")


def _real_rows() -> Iterator[Row]:
    cloud = dense_cloud()
    if cloud is None:
        return
    maps: dict[float, list[Windows]] = {size: [] for size in SIZES}
    for seed, shift in enumerate(_REAL_SHIFTS_M):
        first, later = (part[known_ground(part).mask] for part in split(cloud, seed))
        motion = shift * find_facets(first).frames[0].axes[0]
        for size, vectors in zip(SIZES, measured(first, later + motion).by_width, strict=True):
            maps[size].append(compared(vectors, motion))
        say(f"real cloud, seed {seed}")
    for size in SIZES:
        yield from _window_rows(f"ground of a {DENSE_HALVES}, moved by 0 to 20 cm", size, maps[size], None)
