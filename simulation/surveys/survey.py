"""Pairs of simulated surveys with everything that is known about them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...engine.core.arrays import Float
from ...engine.core.progress import Progress
from ...engine.geometry.rigid_transform import RigidTransform
from ...engine.grid.grid import Grid
from ...interface.parameters import SurveyParameters
from ..frame import Frame
from ..motion.moved_ground import SurfaceMotion
from ..motion.placing import KINDS, motions_on
from .change import Bump, Change, Cone, Plateau, Slump, true_change_raster
from .layers import Cover, Landscape
from .pattern import Flight, Scanner, plan_flight
from .plants import cover_of
from .scanner import SurveyCloud, scan, survey
from .scene import BERM_WIDTH, Relief, Scene, build_scene, cut_profile
from .true_motion import change_raster, ground_motion
from .vegetation import Canopy, grow
from .weathering import eroded, grown

Area = tuple[float, float, float, float]
ROI_SHARE = 0.58
"""Share of a cloud's points that the ROI around the slope holds."""
ROTATION = 2e-4
"""Rotation of the known rigid offset, rad: 6 mm at 30 m, what a survey-grade attitude leaves."""
CRS = "EPSG:32651"
MOVED_SUBSAMPLES = 8
"""Places along a cell's side at which the height of moved ground is taken at most: it is rough, but costs more."""


@dataclass(frozen=True)
class SimulatedPair:
    """Two epochs and the truth about them.

    ``transform`` maps the second epoch's coordinates (moving) to the first's (reference). ``roi`` is the ring of
    the region of interest (n, 2), closed, in the first epoch's coordinates; ``scene`` holds changes and motions and is
    the second epoch's ground in the first epoch's coordinates, ``before`` the first one's.
    """

    parameters: SurveyParameters
    first: SurveyCloud
    second: SurveyCloud
    transform: RigidTransform
    scene: Scene
    before: Scene
    canopy: Canopy
    area: Area
    roi: Float
    crs: str = CRS
    dates: tuple[str, str] = ("2024-05-01", "2025-05-01")
    covers: tuple[Cover | None, Cover | None] = (None, None)

    @property
    def changes(self) -> tuple[Change, ...]:
        return self.scene.changes

    @property
    def motions(self) -> tuple[SurfaceMotion, ...]:
        return self.scene.motions

    def true_motion(self, world: Float) -> Float:
        """(n, 3) way east, north and up of the ground under (n, 2+) coordinates of the first epoch, m.

        0 where it rests, NaN where it is buried afterwards.
        """
        return ground_motion(self.scene, self.before, world)

    def true_change_raster(self, grid: Grid, subsamples: int = 32) -> Float:
        """Mean true change of each cell of a grid in the first epoch's coordinates (rows, columns), m."""
        if self.motions or self.scene.base is not self.before.base:
            return change_raster(self.scene, self.before, grid, min(subsamples, MOVED_SUBSAMPLES))
        return true_change_raster(self.changes, self.scene.frame, grid, subsamples)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north of the surveyed area."""
        ring = rectangle(self.area, self.scene.frame)
        (west, south), (east, north) = ring.min(axis=0), ring.max(axis=0)
        return float(west), float(south), float(east), float(north)


def rectangle(area: Area, frame: Frame) -> Float:
    """Closed ring (5, 2) in the world of a rectangle in the local frame."""
    u0, v0, u1, v1 = area
    corners = np.array([[u0, v0, 0], [u1, v0, 0], [u1, v1, 0], [u0, v1, 0], [u0, v0, 0]], dtype=float)
    return frame.to_world(corners)[:, :2]


def simulate_pair(
    parameters: SurveyParameters | None = None,
    progress: Progress | None = None,
    changes: tuple[Change, ...] | None = None,
    relief: Relief | None = None,
    frame: Frame | None = None,
    roi_buffer: float = 0.0,
    motions: tuple[SurfaceMotion, ...] | None = None,
) -> SimulatedPair:
    """Two surveys of one cut slope: the second with ``changes`` (by default one of each kind) and a rigid offset.

    Ground that moves along itself, by ``motions`` or as the parameters say, takes the place of the default changes.

    Shrubs, trees, ferns, forest and turf are the same in both epochs; closed grass has grown anew between them, or is
    mown in one. All but shrubs and trees move with the ground. The ROI runs along toe and crest,
    ``roi_buffer`` m outside of the cut face.

    Raises:
        TooFarError: ground would move too far for its soft edge.
    """
    parameters = parameters or SurveyParameters()
    progress = progress or Progress()
    frame, relief = frame or Frame(), relief or Relief()
    with progress.stage(0.0, 0.3):
        slope = built_slope(parameters, relief, frame, roi_buffer, progress)
    scene, roi = slope.scene, slope.roi
    covers = (cover_of(parameters, scene, 0), cover_of(parameters, scene, 1))
    if motions is None:
        motions = motions_of(parameters, parameters.motion_amount)
    if changes is None:
        amplitude = 0.0 if motions else parameters.amplitude
        changes = default_changes(scene.slope, amplitude, np.random.default_rng([parameters.seed, 3]))
    transform = known_offset(scene, parameters.offset, np.random.default_rng([parameters.seed, 4]))
    changed = weathered(scene, parameters, relief, 1).with_motions(motions).with_changes(changes)
    area, pulses = survey_area(Landscape(scene, slope.canopy, covers[0]), slope.plan, roi, parameters)
    clouds = []
    for epoch, ground in enumerate((scene, changed)):
        with progress.stage(0.3 + 0.35 * epoch, 0.65 + 0.35 * epoch, f"scanning epoch {epoch + 1}") as stage:
            landscape = Landscape(ground, slope.canopy, covers[epoch])
            seed = (parameters.seed, 11 + epoch)
            clouds.append(survey(landscape, slope.plan, area, pulses, parameters.range_noise, seed, stage))
    moved = replace(clouds[1], xyz=transform.inverse().apply(clouds[1].xyz))
    ring = rectangle(roi, scene.frame)
    return SimulatedPair(
        parameters, clouds[0], moved, transform, changed, scene, slope.canopy, area, ring, covers=covers
    )


def motions_of(parameters: SurveyParameters, amount: float, count: int | None = None) -> tuple[SurfaceMotion, ...]:
    """The motions that the parameter ``motion`` names, each by ``amount`` m; none for ``none`` or 0.

    Args:
        count: so many side by side, the kinds of ``all`` in turn; None: one, or one of each kind.

    Raises:
        TooFarError: ground would move too far for its soft edge.
    """
    if parameters.motion == "none" or amount == 0:
        return ()
    kinds: tuple[str, ...] = KINDS if parameters.motion == "all" else (parameters.motion,)
    if count is not None:
        kinds = tuple(kinds[number % len(kinds)] for number in range(count))
    profile = cut_profile(parameters.height, parameters.angle, parameters.benches)
    return motions_on((profile.v, profile.z), slope_of(parameters), kinds, amount)


def weathered(scene: Scene, parameters: SurveyParameters, relief: Relief, epoch: int) -> Scene:
    """The scene with the erosion and the growth of grass until ``epoch``, the ``scene`` being the one before it."""
    ground = eroded(scene, parameters.erosion, relief, np.random.default_rng([parameters.seed, 6, epoch]))
    return grown(ground, parameters.grass_growth, np.random.default_rng([parameters.seed, 7, epoch]))


@dataclass(frozen=True)
class BuiltSlope:
    """A slope before any change, its shrubs and trees, the region of interest (u and v from, to) and the flight."""

    scene: Scene
    canopy: Canopy
    roi: Area
    plan: Flight


def slope_of(parameters: SurveyParameters) -> Area:
    """u and v from, u and v to of the cut face that the parameters describe."""
    run = parameters.height / math.tan(math.radians(parameters.angle)) + parameters.benches * BERM_WIDTH
    return 0.0, 0.0, parameters.length, run


def built_slope(
    parameters: SurveyParameters, relief: Relief, frame: Frame, roi_buffer: float, progress: Progress
) -> BuiltSlope:
    """The cut slope that the parameters describe; the region reaches ``roi_buffer`` m beyond its face."""
    slope = slope_of(parameters)
    roi = expand(slope, roi_buffer)
    profile = cut_profile(parameters.height, parameters.angle, parameters.benches)
    with progress.stage(0.0, 1 / 3, "building the ground"):
        rng = np.random.default_rng([parameters.seed, 1])
        scene = build_scene(profile, slope, roi_buffer + largest_margin(roi) + 9.0, frame, relief, rng)
    with progress.stage(1 / 3, 1.0, "planting"):
        canopy = grow(scene, parameters.vegetation, np.random.default_rng([parameters.seed, 2]), progress=progress)
    return BuiltSlope(scene, canopy, roi, plan_flight(roi, profile, Scanner()))


def simulate_controlled_test(seed: int = 1, density: float = 1800.0, offset: float = 0.0) -> SimulatedPair:
    """Replica of the published controlled test: a plateau and a cone appear on vegetated ground.

    Args:
        density: returns per m² of the test field of 20 x 20 m, which is inclined by 12 degrees; 1800 makes the share of
            0.1 m cells with ground in both epochs about the published 94.7 %.
    """
    side, angle = 20.0, 12.0
    rise = side * math.tan(math.radians(angle))
    parameters = SurveyParameters(
        seed=seed,
        points=round(density * side**2 / ROI_SHARE),
        length=side,
        height=rise,
        angle=angle,
        vegetation=0.6,
        range_noise=0.02,
        offset=offset,
        amplitude=0.36,
    )
    rng = np.random.default_rng([seed, 5])
    shift = rng.uniform(-0.5, 0.5, 4)
    changes = (
        Plateau(0.32 * side + shift[0], 0.5 * side + shift[1], rotation=float(rng.uniform(0.0, 90.0))),
        Cone(0.68 * side + shift[2], 0.5 * side + shift[3]),
    )
    return simulate_pair(parameters, None, changes, Relief(undulation_rms=0.05, roughness_rms=0.02))


def default_changes(slope: Area, amplitude: float, rng: np.random.Generator) -> tuple[Change, ...]:
    """A bulge, a depression and a slump on the slope, at most about a tenth of its area; none for amplitude 0."""
    if amplitude == 0:
        return ()
    u0, v0, u1, v1 = slope
    width, run = u1 - u0, v1 - v0
    size = min(4.0, 0.09 * width, 0.16 * run)
    centres = u0 + width * (np.array([0.2, 0.5, 0.8]) + rng.uniform(-0.04, 0.04, 3))
    order = rng.permutation(3)
    heights = v0 + run * rng.uniform(0.38, 0.62, 3)
    bulge, bowl, slump = centres[order]
    return (
        Bump(float(bulge), float(heights[0]), 1.2 * size, 0.8 * size, amplitude),
        Bump(float(bowl), float(heights[1]), 0.9 * size, 0.7 * size, -amplitude),
        Slump(float(slump), float(heights[2]), 0.9 * size, 2.8 * size, 0.8 * amplitude),
    )


def known_offset(scene: Scene, offset: float, rng: np.random.Generator) -> RigidTransform:
    """A rigid motion about the slope's centre: translation of norm ``offset`` m and a rotation of ROTATION rad."""
    u0, v0, u1, v1 = scene.slope
    middle = np.array([[(u0 + u1) / 2, (v0 + v1) / 2, 0.0]])
    middle[0, 2] = scene.profile(middle[:, 1])[0]
    direction, axis = rng.standard_normal(3), rng.standard_normal(3)
    translation = offset * direction / np.linalg.norm(direction)
    x, y, z = axis / np.linalg.norm(axis)
    angle = ROTATION if offset > 0 else 0.0
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return RigidTransform(rotation, translation, scene.frame.to_world(middle)[0])


def survey_area(landscape: Landscape, flight: Flight, roi: Area, parameters: SurveyParameters) -> tuple[Area, int]:
    """The area around the ROI of which the ROI holds ROI_SHARE of the points, and the pulses that give the points asked
    for.

    Both from a pilot scan: density falls off at the edges of the flight, and leaves return more than bare ground.
    """
    widest = expand(roi, largest_margin(roi))
    pilot = 60_000
    cloud = scan(landscape, flight, widest, pilot, 0.0, (parameters.seed, 10))
    local = landscape.scene.frame.to_local(cloud.xyz)
    # Margin at which each point comes in.
    beyond = np.maximum.reduce([roi[0] - local[:, 0], local[:, 0] - roi[2], roi[1] - local[:, 1], local[:, 1] - roi[3]])
    beyond = np.sort(beyond)
    held = np.count_nonzero(beyond <= 0)
    wanted = min(round(held / ROI_SHARE), len(beyond))
    area = expand(roi, max(float(beyond[wanted - 1]), 0.5))
    return area, max(1, math.ceil(parameters.points * pilot / max(wanted, 1)))


def largest_margin(roi: Area) -> float:
    """Margin of the ground that is modelled around the ROI, m: twice that of an even density."""
    a, b = roi[2] - roi[0], roi[3] - roi[1]
    # (a + 2 m)(b + 2 m) = a b / ROI_SHARE
    half = (a + b) / 2
    return -half + math.sqrt(half**2 + a * b * (1 / ROI_SHARE - 1))


def expand(area: Area, margin: float) -> Area:
    return area[0] - margin, area[1] - margin, area[2] + margin, area[3] + margin
