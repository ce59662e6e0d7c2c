"""M3C2's level of detection where nothing moved, and where something did: calibrated, as published, and py4dgeo's.

Counted are core points beyond their 95 % level, by slope: of two airborne strips, of halves of a dense cloud, and of
simulated surveys, bare and of ground extracted under plants. "In the other half" is learned on one half (west or east)
as if it alone were known to be stable, and counted on the other, in turn.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...engine.change.difference import uniform_shift
from ...engine.core.arrays import Bool, Float
from ...engine.grid.common_grid import common_grid
from ...engine.grid.grid import cell_index
from ...engine.m3c2.distances import Cylinder, Distances, LevelTerms, m3c2_distances
from ...engine.m3c2.lattice import Lattice
from ...engine.m3c2.level import calibrated, slope_of
from ...engine.m3c2.normals import fit_planes
from ...engine.m3c2.scales import choose_scales, overlap_bounds, spread_cores
from ...interface.parameters import DistanceParameters, GridChangeParameters, SurveyParameters
from ...simulation.surveys.survey import SimulatedPair, simulate_pair
from . import strips
from .chain import Ground, registered
from .peers import PeerMissingError, run_on_arrays, version
from .real_data import DENSE_HALVES, dense_cloud, split
from .slope_classes import TARGET, met, shares_by_slope, text
from .table import Row, say

STRIP_SCALES = (0.0, 2.0)
"""Projection scales (m); 0: as the clouds choose."""
FACES = ((30.0, 0.0), (45.0, 0.0), (60.0, 0.0), (30.0, 0.5), (45.0, 0.5), (60.0, 0.5))
"""Degrees, and share of the ground under plants."""
POINTS = 250_000
CHANGED = 0.03  # m; what moved by less is neither changed nor unchanged
MOVED = ((30.0, 0.0), (45.0, 0.5), (60.0, 0.3))
AMPLITUDES = (0.05, 0.2)
_PEER = """
import json, sys
import numpy as np, py4dgeo
folder, radius, half_length, error = sys.argv[1], *map(float, sys.argv[2:5])
first, second, core, normal = (np.load(f"{folder}/{n}.npy") for n in ("first", "second", "core", "normal"))
origin = first.mean(axis=0)
epochs = py4dgeo.Epoch(first - origin), py4dgeo.Epoch(second - origin)
distance, report = py4dgeo.M3C2(
    epochs=epochs, corepoints=core - origin, corepoint_normals=normal, cyl_radius=radius, max_distance=half_length,
    registration_error=error,
).run()
np.save(f"{folder}/peer.npy", np.column_stack([distance, report["lodetection"]]))
print(json.dumps({}))
"""


@dataclass(frozen=True)
class Pair:
    """The registered ground of two epochs, and the standard error of their registration, metres."""

    first: Ground
    second: Ground
    registration_error: float


@dataclass(frozen=True)
class Measured:
    """Distances with the published level, with the calibrated, and of the halves learned elsewhere; the cylinder."""

    pair: Pair
    published: Distances
    level: Distances
    other_halves: tuple[tuple[Distances, Bool], ...]
    radius: float
    half_length: float


def rows() -> list[Row]:
    """Unchanged surveys, real and simulated, and simulated ones with change."""
    found = []
    if strips.FILE.exists():
        loaded = strips.load()
        pair = Pair(Ground(loaded.first), Ground(loaded.registered), loaded.registration_error)
        for scale in STRIP_SCALES:
            made = measure(pair, scale)
            found.append(_row(f"two airborne strips, cylinder of {2 * made.radius:g} m", [made]))
    cloud = dense_cloud()
    if cloud is not None:
        first, second = split(cloud, 1)
        made = measure(Pair(Ground(first), Ground(second), 0.0))
        found.append(_row(f"{DENSE_HALVES}, cylinder of {2 * made.radius:g} m", [made]))
    for name, faces in (("bare", FACES[:3]), ("ground extracted under 50 % plants", FACES[3:])):
        measured = [measure(pair) for _, pair in _simulated(faces, 0.0)]
        found.append(_row(f"simulated, {name}", measured))
    return found + [_change_row(amplitude) for amplitude in AMPLITUDES]


def measure(pair: Pair, scale: float = 0.0) -> Measured:
    """M3C2 at the scales that the clouds choose, or with a cylinder of ``scale`` metres."""
    first, second = pair.first.xyz, pair.second.xyz
    scales = choose_scales(first, second, DistanceParameters(projection_scale=scale))
    core = first[spread_cores(first, scales.core_spacing, overlap_bounds(first, second))]
    normal = fit_planes(Lattice(first, scales.normal_scale / 2), core, scales.normal_scale).normal
    radius = scales.projection_scale / 2
    one, two = (
        Lattice(ground.xyz, radius, values=None if ground.plants is None else ground.plants.error)
        for ground in (pair.first, pair.second)
    )
    published = m3c2_distances(
        (one, two),
        core,
        normal,
        Cylinder(radius, scales.half_length),
        LevelTerms(registration_error=pair.registration_error),
        spread=True,
    )
    shift = uniform_shift(published.distance[published.measured], published.level[published.measured])
    west = core[:, 0] < float(np.median(core[:, 0]))
    return Measured(
        pair,
        published,
        calibrated(published, radius, uniform=shift is not None),
        tuple((calibrated(published, radius, given=known), ~known) for known in (west, ~west)),
        radius,
        scales.half_length,
    )


def shares(distances: Sequence[Distances], where: Sequence[Bool] | None = None) -> dict[str, float]:
    """Share of significant core points by class of slope."""
    which = [d.measured if where is None else d.measured & where[k] for k, d in enumerate(distances)]
    slope = np.concatenate([slope_of(d.normal)[w] for d, w in zip(distances, which, strict=True)])
    significant = np.concatenate([d.significant[w] for d, w in zip(distances, which, strict=True)])
    return shares_by_slope(slope, significant)


def _simulated(faces: Sequence[tuple[float, float]], amplitude: float) -> Iterator[tuple[SimulatedPair, Pair]]:
    """Two surveys of a cut face with a road, a berm and a shoulder each; their ground extracted and registered."""
    for number, (angle, vegetation) in enumerate(faces, 1):
        parameters = SurveyParameters(
            seed=number,
            points=POINTS,
            length=40.0,
            height=16.0,
            angle=angle,
            benches=1,
            vegetation=vegetation,
            amplitude=amplitude,
            offset=0.05,
        )
        simulated = simulate_pair(parameters, roi_buffer=3.0)
        result, first, second = registered(simulated)
        say(f"{angle:g} degrees: {len(first.xyz)} ground points")
        yield simulated, Pair(first, second, result.registration_error)


def _row(name: str, measured: list[Measured]) -> Row:
    own = shares([m.level for m in measured])
    halves = [half for m in measured for half in m.other_halves]
    other = shares([d for d, _ in halves], [w for _, w in halves])
    published = shares([m.published for m in measured])
    levels = [float(np.median(np.concatenate([getattr(m, k).level[m.published.measured] for m in measured])))
              for k in ("level", "published")]  # fmt: skip
    return Row(
        f"{name}: core points beyond the 95 % level by slope",
        f"{text(own)}; in the other half: {text(other)}; median level {1000 * levels[0]:.1f} mm",
        TARGET,
        f"as published: {text(published)}, {1000 * levels[1]:.1f} mm; {_peer_text(measured)}",
        met(own, other),
    )


def _peer_text(measured: list[Measured]) -> str:
    try:
        of_all = [_peer(m) for m in measured]
    except PeerMissingError as error:
        return f"py4dgeo not measured: {error}"
    return f"py4dgeo {version('py4dgeo')}: {text(shares(of_all))}"


def _peer(measured: Measured) -> Distances:
    """py4dgeo's distances and levels at the same core points, along the same normals."""
    published = measured.published
    arrays = {
        "first": measured.pair.first.xyz,
        "second": measured.pair.second.xyz,
        "core": published.core,
        "normal": published.normal,
    }
    numbers = (measured.radius, measured.half_length, published.registration_error)
    distance, level = run_on_arrays("py4dgeo", _PEER, arrays, *numbers)[1].T
    with np.errstate(invalid="ignore"):
        return Distances(**(vars(published) | {"distance": distance, "significant": np.abs(distance) > level}))


def _change_row(amplitude: float) -> Row:
    """Of surveys in which places moved by up to ``amplitude`` metres."""
    changed, unchanged = np.zeros((2, 2)), np.zeros((2, 2))  # calibrated, published; beyond, all
    scaled = np.zeros(2)
    for simulated, pair in _simulated(MOVED, amplitude):
        made = measure(pair)
        truth = _true_change(simulated, made.published.core)
        moved, still = np.abs(truth) > min(CHANGED, amplitude / 2), truth == 0
        for number, found in enumerate((made.level, made.published)):
            for totals, cores in ((changed, moved), (unchanged, still)):
                counted = found.measured & cores
                totals[number] += found.significant[counted].sum(), counted.sum()
        scaled += _at_the_same_share(made, moved & made.published.measured, still & made.published.measured)
    (found, plain), (false, plain_false) = (100 * t[:, 0] / t[:, 1] for t in (changed, unchanged))
    alike = 100 * scaled[0] / scaled[1]
    return Row(
        f"simulated, change of up to {amplitude:g} m: changed core points beyond the level",
        f"{found:.1f} % of {changed[0, 1]:.0f}; of unchanged {false:.1f} %",
        "no fewer than as published at the same share of unchanged",
        f"as published: {plain:.1f} %; of unchanged {plain_false:.1f} %; scaled to the same share: {alike:.1f} %",
        bool(found >= alike),
    )


def _at_the_same_share(made: Measured, moved: Bool, still: Bool) -> tuple[int, int]:
    """Changed core points beyond the published level, scaled so that as many unchanged ones are as calibrated; all."""
    ratio = np.abs(made.published.distance) / made.published.level
    scale = np.quantile(ratio[still], 1.0 - made.level.significant[still].mean())
    return int(np.count_nonzero(ratio[moved] > scale)), int(np.count_nonzero(moved))


def _true_change(simulated: SimulatedPair, core: Float) -> Float:
    """True change of height at core points (m, 3), metres (m,)."""
    grid = common_grid(core, core, GridChangeParameters(cell=0.1))
    return simulated.true_change_raster(grid, 4).ravel()[cell_index(core, grid)]
