"""The ground that the raster network learns from: real clouds and elevation models of a folder, and simulated slopes.

Real ground is not part of this repository. Files that are missing are left out, so that the same command trains on what
there is; what took part is written into the weights' description.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np
import rasterio

from ...engine.core.arrays import Float
from ...engine.core.errors import InputError
from ...engine.core.progress import Progress
from ...models.preparation.inserted_hazards import ground_density, thinned
from ...models.preparation.prepare import UNKNOWN
from ...models.training.relief_patches import Ground
from ...simulation.hazard_scenes.scenes import build_scene
from ...simulation.hazard_scenes.styles import SceneSpec, log_uniform
from ...simulation.hazard_scenes.terrain import build_terrain
from .left_by_plants import left_by_plants
from .rough_ground import natural, textured, with_relief
from .shipping import training_scenes

GROUND_CLASS = 2
DENSEST = 60.0
"""Ground denser than this is thinned to it, points/m²."""
SIMULATED_DENSITY = (4.0, 60.0)
FIRST_SIMULATED = 500_000
"""Number of the first simulated slope: the shipped weights' scenes have lower, their held-out ones higher numbers."""
HILLSIDE_SHARE, ENGINEERED_SHARE = 0.2, 0.45
"""Benches repeat every 10 m or so and outweigh any relief; most real ground to train on has none. Real ground is the
other half of what a network learns from, so that most simulated slopes stay engineered: with both shares and what
``natural`` draws, 40 % of them have natural relief."""
PLANTED_SHARE = 0.5
OWN_HAZARDS_SHARE, OWN_HAZARDS_COVER = 0.5, 0.05
"""Of slopes that keep the scene's own hazards, labelled: their forms are those of failures on cut slopes, which those
put in later are not; and the largest share of the slope that either class then covers."""
_TRIES, _TRIES_APART = 20, 15_000


@dataclass(frozen=True)
class Site:
    """A file of real ground and how it is used (see ``Ground``): the ``survey`` whose site can be left out, ``scales``
    by which it may be stretched, whether it is ``smooth``, ``weight``. ``classified``: whether only class 2 is ground.
    """

    survey: str
    file: str
    scales: tuple[float, float]
    smooth: bool
    weight: float
    classified: bool = True


SITES = (
    Site("santa_cruz", "terrain/santa_cruz_gullies.laz", (0.6, 1.5), False, 3.0),
    Site("alpine", "real/ign_tiles/alpine_slope.laz", (0.6, 1.6), False, 0.5),
    Site("IGN tile 627755", "real/ign_tiles/test_data_77050_627755_LA93_IGN69.laz", (0.7, 1.5), False, 1.0),
    Site("IGN tile 627760", "real/ign_tiles/test_data_77050_627760_LA93_IGN69.laz", (0.7, 1.5), False, 1.0),
    Site("chablais", "terrain/chablais_forest.laz", (0.4, 1.1), True, 1.0),
    Site("afghan", "terrain/afghan_mountain_ground.laz", (0.25, 1.0), True, 1.5),
    Site("british_columbia", "terrain/british_columbia_forest_ground.laz", (0.3, 1.0), True, 1.5),
    Site("british_columbia", "terrain/british_columbia_forest.laz", (0.3, 1.0), True, 1.0),
    Site("coromandel", "terrain/coromandel_forest.laz", (0.3, 1.0), True, 0.5),
    Site("lone-star", "real/lone-star.copc.laz", (0.6, 1.5), False, 0.5, classified=False),
    Site("slovenia", "terrain/slovenia_1m.tif", (0.2, 0.8), True, 2.0),
    Site("colorado", "terrain/colorado_1m.tif", (0.2, 0.8), True, 1.5),
    Site("carrizo", "terrain/carrizo_fault_2m.tif", (0.12, 0.4), True, 1.0),
    Site("fort_bragg", "dem_epochs/fort_bragg_gully_2016.tif", (0.2, 0.8), True, 1.0),
    Site("fort_bragg", "dem_epochs/fort_bragg_gully_2004.tif", (0.2, 0.8), True, 1.0),
    Site("toronto", "dem_epochs/toronto_park_2023.tif", (0.2, 0.8), True, 0.5),
)


def real_grounds(folder: Path, left_out: Collection[str] = ()) -> list[Ground]:
    """The sites whose files lie under ``folder``, without the surveys ``left_out``.

    Raises:
        InputError: none is left, or a survey to leave out is not in the table.
    """
    unknown = set(left_out) - {site.survey for site in SITES}
    if unknown:
        known = ", ".join(sorted({site.survey for site in SITES}))
        raise InputError(f"There is no survey {', '.join(sorted(unknown))} to leave out; give one of {known}.")
    found = [
        _ground(site, folder / site.file)
        for site in SITES
        if site.survey not in left_out and (folder / site.file).is_file()
    ]
    if not found:
        raise InputError(f"The folder {folder} holds none of the known files of real ground; give the one that does.")
    return found


def simulated_grounds(count: int, progress: Progress | None = None) -> list[Ground]:
    """``count`` simulated slopes with all their structures and natural relief. ``OWN_HAZARDS_SHARE`` of them have
    hazards, labelled; the others have none, and ``PLANTED_SHARE`` of these are as extracted among plants.
    ``HILLSIDE_SHARE`` are hillsides, not benched and with natural relief; ``ENGINEERED_SHARE`` have none of it, at most
    textures; the others are as ``natural`` draws them.
    """
    progress = progress or Progress()
    found = []
    for number in range(count):
        drawn = np.random.default_rng([FIRST_SIMULATED, number]).random()
        hillside, engineered = drawn < HILLSIDE_SHARE, drawn >= 1.0 - ENGINEERED_SHARE
        spec = _not_benched(number) if hillside else _specification(number)
        rougher_ground = with_relief if hillside else textured if engineered else natural
        rng = np.random.default_rng([spec.seed, 5])
        labelled = rng.random() < OWN_HAZARDS_SHARE
        spec = spec if labelled else replace(spec, uplift=0.0, subsidence=0.0)
        scene = rougher_ground(build_scene(spec), np.random.default_rng([spec.seed, 3]))
        xyz, labels = scene.xyz, None
        if labelled:
            labels = np.where(scene.ignore, UNKNOWN, scene.label).astype(np.uint8)
        elif rng.random() < PLANTED_SHARE:
            xyz = left_by_plants(xyz, rng)
        found.append(Ground(f"simulated {spec.seed}", xyz, ground_density(xyz[:, :2]), labels=labels))
        progress.update((number + 1) / count, f"slope {number + 1} of {count}")
    return found


def _specification(number: int) -> SceneSpec:
    """Of a slope with few hazards, of a density that real ground has."""
    spec = next(training_scenes(1, FIRST_SIMULATED + number))
    density = log_uniform(SIMULATED_DENSITY, np.random.default_rng([spec.seed, 4]))
    up, down = (min(2.0 * share, OWN_HAZARDS_COVER) for share in (spec.uplift, spec.subsidence))
    return replace(spec, uplift=up, subsidence=down, density=density)


def _not_benched(number: int) -> SceneSpec:
    """The first of several specifications whose slope has no benches; each number has its own."""
    for k in range(_TRIES):
        spec = _specification(number + k * _TRIES_APART)
        if not build_terrain(spec, spec.generator(1)).benches:
            break
    return spec


def _ground(site: Site, path: Path) -> Ground:
    points = elevation_points(path) if path.suffix == ".tif" else _cloud(path, site.classified)
    points = points - [*points[:, :2].min(axis=0), np.median(points[:, 2])]
    points = points[thinned(points, DENSEST, np.random.default_rng(0))]
    return Ground(path.stem, points, ground_density(points[:, :2]), site.scales, site.smooth, site.weight)


def _cloud(path: Path, classified: bool) -> Float:
    las = laspy.read(path)
    xyz = np.array(las.xyz)
    return xyz[np.asarray(las.classification) == GROUND_CLASS] if classified else xyz


def elevation_points(path: Path) -> Float:
    """Cells (n, 3) of an elevation model with data, in metres about its corner."""
    with rasterio.open(path) as source:
        height = source.read(1, masked=True).astype(np.float64).filled(np.nan)
        side = float(source.res[0])
    row, column = np.nonzero(np.isfinite(height))
    return np.column_stack([(column + 0.5) * side, -(row + 0.5) * side, height[row, column]])
