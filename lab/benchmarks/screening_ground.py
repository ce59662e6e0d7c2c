"""Ground that screening is judged on: real clouds and elevation models next to the checkout, and simulated slopes.

Large clouds are cut into square patches; patches of one place carry the place's name as ``group``, so that none of them
is judged by a threshold from its neighbours.
"""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np

from ...engine.core.arrays import Float
from ...engine.core.errors import InputError
from ...engine.geometry.dominant_plane import apply_matrix
from ...engine.ground.extraction import extract_ground
from ...models.configuration import ModelConfiguration
from ...models.preparation.inserted_hazards import thinned
from ...models.preparation.prepare import flat_frame
from ...simulation.hazard_scenes.scenes import build_scene
from ...simulation.hazard_scenes.styles import draw_spec
from ..making.relief_grounds import elevation_points

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
FRAME = ModelConfiguration(features=("x", "y", "z"))
PATCH_M = 60.0
MODEL_PATCH_M = 120.0
"""Side of the patches of clouds and of elevation models."""
FIRST_SEED = 880_000
"""Of simulated slopes: neither training nor a benchmark set has them."""
_MIN_AREA_M2 = 150.0
_OWN_PATCHES = 3
_DENSE = 100.0
"""Clouds denser than this are thinned to it, points/m²."""

POINTS, ELEVATION, SIMULATED = "points", "elevation", "simulated"


@dataclass(frozen=True)
class Place:
    """Ground points ``flat`` (n, 3) of a slope in its flat frame, m, y up the slope; ``matrix`` (4, 4) leads there.

    ``kind`` is ``points``, ``elevation`` (an elevation model's cells) or ``simulated``; ``group`` the survey.
    """

    name: str
    group: str
    kind: str
    flat: Float
    matrix: Float

    @property
    def density(self) -> float:
        """Median points of the occupied square metres."""
        cells = np.unique(np.floor(self.flat[:, :2]).astype(np.int64), axis=0, return_counts=True)[1]
        return float(np.median(cells))


def place(name: str, group: str, kind: str, xyz: Float) -> Place:
    """Lay points (n, 3) flat."""
    _, matrix = flat_frame(xyz, FRAME)
    return Place(name, group, kind, apply_matrix(matrix, xyz), matrix)


def real_places(*, extract: bool = True, keep: Path | None = None) -> list[Place]:
    """What lies next to the checkout.

    Args:
        extract: whether clouds without a class for ground take part, by the project's own extraction (takes minutes).
        keep: folder for the ground that is extracted, so that a later run need not do it again.
    """
    return [*_clouds(extract, keep), *_elevation_models()]


def own_places(paths: Iterable[Path]) -> list[Place]:
    """Places of files of one's own: LAS or LAZ clouds (class 2, or all points where there is none) and GeoTIFF
    elevation models in metres. Each file is a survey with its name, up to ``_OWN_PATCHES`` places large.

    Raises:
        InputError: a file is missing or no such file, or it holds too little ground.
    """
    found = []
    for path in paths:
        suffix = path.suffix.lower()
        if not path.is_file() or suffix not in {".las", ".laz", ".tif", ".tiff"}:
            raise InputError(f"The ground {path} is no LAS, LAZ or GeoTIFF file; give one that exists.")
        if suffix in {".las", ".laz"}:
            mine = _cloud_places(path.stem, _class_2_or_all(path), _OWN_PATCHES)
        else:
            squares = _steepest(patches(elevation_points(path), MODEL_PATCH_M, 1000), _OWN_PATCHES)
            mine = [place(f"{path.stem} {number}", path.stem, ELEVATION, xyz) for number, xyz in enumerate(squares, 1)]
        if not mine:
            raise InputError(f"The ground {path} covers less than {_MIN_AREA_M2:g} m²; give a larger one.")
        found.extend(mine)
    return found


def simulated_places(count: int = 3, *, area: float = 3600.0) -> list[Place]:
    """``count`` slopes of each kind of scene, without hazards but with all hard negatives."""
    found = []
    for kind in ("realistic", "published", "shifted"):
        for number in range(count):
            density = (20.0, 40.0, 80.0)[number % 3]
            spec = draw_spec(FIRST_SEED + number, kind, area=area, density=density)
            scene = build_scene(replace(spec, uplift=0.0, subsidence=0.0))
            found.append(
                place(f"simulated {kind} {number + 1}", f"simulated {kind} {number + 1}", SIMULATED, scene.xyz)
            )
    return found


def patches(xyz: Float, side: float, most: int) -> Iterator[Float]:
    """Up to ``most`` squares of ``side`` m in x and y that points (n, 3) fill well, best filled first; the whole cloud
    where it is smaller than one and a half.
    """
    if (np.ptp(xyz[:, :2], axis=0) < 1.5 * side).all():
        yield xyz
        return
    cell = np.floor((xyz[:, :2] - xyz[:, :2].min(axis=0)) / side).astype(np.int64)
    key = cell[:, 0] * (int(cell[:, 1].max()) + 1) + cell[:, 1]
    filled: dict[int, int] = {}
    square = np.unique(np.column_stack([key, *np.floor(xyz[:, :2] / 3.0).astype(np.int64).T]), axis=0)[:, 0]
    for number, count in zip(*np.unique(square, return_counts=True), strict=True):
        filled[int(number)] = int(count)
    best = sorted(filled, key=lambda number: -filled[number])
    full = [number for number in best if filled[number] > 0.5 * (side / 3.0) ** 2]
    for number in full[:most]:
        yield xyz[key == number]


def _clouds(extract: bool, keep: Path | None = None) -> Iterator[Place]:
    terrain, tiles = SHARED / "terrain", SHARED / "real" / "ign_tiles"
    listed: list[tuple[str, Path, Callable[[Path], Float], int]] = [
        ("santa_cruz", terrain / "santa_cruz_gullies.laz", _class_2, 6),
        ("alpine", tiles / "alpine_slope.laz", _class_2, 1),
        ("IGN tile 627755", tiles / "test_data_77050_627755_LA93_IGN69.laz", _class_2, 1),
        ("IGN tile 627760", tiles / "test_data_77050_627760_LA93_IGN69.laz", _class_2, 1),
        ("chablais", terrain / "chablais_forest.laz", _class_2, 1),
        ("afghan", terrain / "afghan_mountain_ground.laz", _class_2, 3),
        ("british_columbia", terrain / "british_columbia_forest_ground.laz", _class_2, 3),
        ("coromandel", terrain / "coromandel_forest.laz", _class_2, 2),
        ("lone-star", SHARED / "real" / "lone-star.copc.laz", _all_points, 1),
    ]
    if extract:
        extracted = functools.partial(_extracted, keep=keep)
        listed.append(("La Reunion", tiles / "sample_lareunion_epsg2975.laz", extracted, 1))
    for group, path, read, most in listed:
        if path.is_file():
            yield from _cloud_places(group, read(path), most)


def _cloud_places(group: str, points: Float, most: int) -> list[Place]:
    """Up to ``most`` places of a cloud (n, 3) that are large enough."""
    found = []
    for number, xyz in enumerate(patches(points, PATCH_M, most), 1):
        one = place(f"{group} {number}" if most > 1 else group, group, POINTS, xyz)
        if one.density > _DENSE:
            one = replace(one, flat=one.flat[thinned(one.flat, _DENSE, np.random.default_rng(0))])
        if len(np.unique(np.floor(one.flat[:, :2]), axis=0)) >= _MIN_AREA_M2:
            found.append(one)
    return found


def _elevation_models() -> Iterator[Place]:
    for group, path, most in (
        ("slovenia", SHARED / "terrain" / "slovenia_1m.tif", 3),
        ("colorado", SHARED / "terrain" / "colorado_1m.tif", 3),
        ("carrizo", SHARED / "terrain" / "carrizo_fault_2m.tif", 3),
        ("fort_bragg", SHARED / "dem_epochs" / "fort_bragg_gully_2016.tif", 2),
        ("toronto", SHARED / "dem_epochs" / "toronto_park_2023.tif", 2),
    ):
        if not path.is_file():
            continue
        for number, xyz in enumerate(_steepest(patches(elevation_points(path), MODEL_PATCH_M, 1000), most), 1):
            yield place(f"{group} {number}", group, ELEVATION, xyz)


def _steepest(candidates: Iterator[Float], most: int) -> list[Float]:
    """The patches with most relief: hazards are sought on slopes."""
    return sorted(candidates, key=lambda xyz: -float(np.subtract(*np.percentile(xyz[:, 2], (95, 5)))))[:most]


def _class_2(path: Path) -> Float:
    las = laspy.read(path)
    return np.array(las.xyz)[np.asarray(las.classification) == 2]


def _all_points(path: Path) -> Float:
    return np.array(laspy.read(path).xyz)


def _class_2_or_all(path: Path) -> Float:
    ground = _class_2(path)
    return ground if len(ground) else _all_points(path)


def _extracted(path: Path, keep: Path | None = None) -> Float:
    if keep is None:
        with tempfile.TemporaryDirectory() as folder:
            return _extracted(path, Path(folder))
    ground = keep / f"{path.stem}_ground.laz"
    if not ground.is_file():
        keep.mkdir(parents=True, exist_ok=True)
        extract_ground(path, ground)
    return _all_points(ground)
