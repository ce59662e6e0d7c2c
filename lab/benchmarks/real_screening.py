"""Screening of real slopes: known hazards put in that are found, and what is shown where nothing was put in.

``python -m slopewatch.lab.benchmarks.real_screening [--weights FILE] [--pictures FOLDER]`` prints the table. The clouds
lie next to the checkout (``../shared/data``). A hazard is found if at least half of its labelled points carry its
class. So that ground which is shown anyhow does not count as skill, each recall is given with the share of the same
places that the screening shows on the untouched cloud, with nothing put in; ``own_relief`` says what the slope itself
allows.
Neither cloud is as dense as the network asks for, so ``slopewatch screen`` may refuse what is measured here.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from ...engine.core.arrays import Float
from ...engine.geometry.dominant_plane import apply_matrix
from ...engine.ground.extraction import extract_ground
from ...models.configuration import CLASSES, ModelConfiguration
from ...models.inference.baseline import residual_probabilities
from ...models.network.shipped import SHIPPED_WEIGHTS, shipped_model
from ...models.preparation.prepare import prepare_cloud
from ...models.preparation.trends import residual_heights
from ...simulation.hazard_scenes.known_hazards import KnownHazards, Site, put_hazards, room_for
from ..making.scene_scores import FOUND, SMALLEST_ZONE, ZONE_CELL
from .own_relief import own_relief
from .real_data import TILES
from .table import Row, heading, markdown, say

AMPLITUDES = (0.15, 0.30, 0.50)
DIAMETERS = (2.0, 3.0, 5.0)
TOGETHER = 3
"""Hazards that are put in at once: more would be the ground rather than lie on it."""
HAZARDS = 30
"""Hazards of each height and size a cloud."""
MAX_SEEDS = 40
TARGET = 0.7
"""Share of the hazards of 0.3 m and 3 m that is to be found."""
TREND = 4.0
"""Reach (m) of the trend that zones' heights are given over."""
FALSE = 0.1
"""Share of untouched places at which a hazard seems to be, by which the slope's own relief is judged."""
LISTED = 10
"""Zones, the largest ones, in the table; all are in the folder of the pictures."""
SITE = Site()

Screening = Callable[[Float], NDArray[np.floating]]
"""From (n, 3) ground points to (n, 3) probabilities of background, uplift and subsidence."""


@dataclass(frozen=True)
class RealGround:
    """Ground points (n, 3) of a real slope. ``density`` (points a m² of the slope's plane) is the median over occupied
    square metres, ``area`` (m²) their number; ``dip`` in degrees; ``matrix`` (4, 4) leads to the flat frame, in which
    y runs up the slope.
    """

    name: str
    xyz: Float
    source: str
    density: float
    area: float
    dip: float
    matrix: Float

    @property
    def flat(self) -> Float:
        """(n, 3) points in the flat frame."""
        return apply_matrix(self.matrix, self.xyz)

    @classmethod
    def of(cls, name: str, xyz: Float, source: str) -> RealGround:
        """Measure the points (n, 3)."""
        cloud = prepare_cloud(xyz, ModelConfiguration(features=("x", "y", "z")))
        flat = apply_matrix(cloud.matrix, xyz)
        cells = np.unique(np.floor(flat[:, :2]).astype(np.int64), axis=0, return_counts=True)[1]
        return cls(name, xyz, source, float(np.median(cells)), float(len(cells)), cloud.plane.dip, cloud.matrix)


@dataclass(frozen=True)
class Trial:
    """One hazard put in: height (m, signed), diameter (m), the share of its points with its class, and on the
    untouched cloud.
    """

    height: float
    diameter: float
    found: float
    before: float


@dataclass(frozen=True)
class Zone:
    """A zone that is shown: class, middle (x, y, z in the cloud's coordinates; u, w in the flat frame), area (m² of
    the slope's plane), points, median height (m) over the trend, mean probability of the class.
    """

    kind: int
    place: tuple[float, float, float]
    flat: tuple[float, float]
    area: float
    points: int
    height: float
    probability: float
    members: NDArray[np.intp]


def real_grounds() -> list[RealGround]:
    """The clouds that lie next to the checkout."""
    found = []
    path = TILES / "sample_lareunion_epsg2975.laz"
    if path.is_file():
        with tempfile.TemporaryDirectory() as folder:
            ground = extract_ground(path, Path(folder) / "ground.laz").ground
            found.append(RealGround.of("La Reunion", np.array(laspy.read(ground).xyz), "extracted"))
    path = TILES / "alpine_slope.laz"
    if path.is_file():
        las = laspy.read(path)
        found.append(
            RealGround.of("alpine", np.array(las.xyz)[np.asarray(las.classification) == 2], "vendor's class 2")
        )
    return found


def trials(
    xyz: Float,
    screening: Screening,
    amplitude: float,
    diameter: float,
    *,
    count: int = HAZARDS,
    untouched: NDArray[np.uint8] | None = None,
) -> list[Trial]:
    """Put at least ``count`` hazards of a size into the ground, a few at a time, half of them bulges, and screen it.

    Args:
        untouched: (n,) classes that the screening gives the untouched cloud, where they are known.

    Returns:
        Fewer where the ground has no room.
    """
    before = screening(xyz).argmax(axis=1) if untouched is None else untouched
    done: list[Trial] = []
    for seed in range(MAX_SEEDS):
        if len(done) >= count:
            break
        wanted = [((-1) ** (seed + i) * amplitude, diameter) for i in range(TOGETHER)]
        scene = put_hazards(xyz, wanted, seed, site=SITE)
        if len(scene.hazards):
            done += scored(scene, screening(scene.xyz).argmax(axis=1), before)
    return done


def scored(scene: KnownHazards, after: NDArray[np.integer], before: NDArray[np.integer]) -> list[Trial]:
    """What a screening's classes (n,) after and before say of each hazard."""
    result = []
    for row in scene.hazards:
        mine = (scene.hazard == row["id"]) & (scene.label > 0)
        sign = 1.0 if row["label"] == 1 else -1.0
        shares = [float(np.mean(classes[mine] == row["label"])) for classes in (after, before)]
        result.append(Trial(sign * float(row["amplitude"]), float(row["diameter"]), *shares))
    return result


def recall(results: Sequence[Trial]) -> tuple[float, float]:
    """Share of the hazards that is found, and that is shown at their places without them."""
    return (
        float(np.mean([trial.found >= FOUND for trial in results])),
        float(np.mean([trial.before >= FOUND for trial in results])),
    )


def shown_zones(ground: RealGround, probabilities: NDArray[np.floating]) -> list[Zone]:
    """Contiguous cells in which most points are of one hazard class, largest first.

    Cells are ``ZONE_CELL`` m or, on sparse ground, as large as two points need. Cells without a point between others
    do not join them.
    """
    flat = ground.flat
    height = residual_heights(flat, TREND, TREND)
    predicted = probabilities.argmax(axis=1)
    size = max(ZONE_CELL, float(np.sqrt(2.0 / ground.density)))
    cell = np.floor((flat[:, :2] - flat[:, :2].min(axis=0)) / size).astype(np.int64)
    shape = tuple(int(n) + 1 for n in cell.max(axis=0))
    index = cell[:, 0] * shape[1] + cell[:, 1]
    points = np.bincount(index, minlength=shape[0] * shape[1])
    zones = []
    for kind in range(1, len(CLASSES)):
        share = np.bincount(index, weights=predicted == kind, minlength=len(points))
        marked, count = label(((share > 0.5 * points) & (points > 0)).reshape(shape), np.ones((3, 3)))
        area = np.bincount(marked.ravel(), minlength=count + 1) * size**2
        for number in range(1, count + 1):
            if area[number] < SMALLEST_ZONE:
                continue
            mine = np.flatnonzero(marked.ravel()[index] == number)
            middle = np.median(ground.xyz[mine], axis=0)
            u, w = np.median(flat[mine, :2], axis=0)
            zones.append(
                Zone(
                    kind,
                    (float(middle[0]), float(middle[1]), float(middle[2])),
                    (float(u), float(w)),
                    float(area[number]),
                    len(mine),
                    float(np.median(height[mine])),
                    float(np.mean(probabilities[mine, kind])),
                    mine,
                )
            )
    return sorted(zones, key=lambda zone: -zone.area)


def screenings(weights: Path | None = None) -> dict[str, Screening]:
    """The network, with the given or the shipped weights, and the residual without learning."""
    from ...models.inference.prediction import predict
    from ...models.network.weights import load_model

    network = (load_model(*shipped_model()) if weights is None else load_model(weights)).network
    return {"network": lambda xyz: predict(network, xyz).probabilities, "residual": residual_probabilities}


def rows(weights: Path | None = None, pictures: Path | None = None) -> list[Row]:
    """The table. Pictures and lists of the zones are written where a folder is given."""
    table: list[Row] = []
    methods = screenings(weights)
    main = next(iter(methods))
    for ground in real_grounds():
        table += [_ground_row(ground), _relief_row(ground)]
        untouched = {name: screen(ground.xyz) for name, screen in methods.items()}
        for amplitude in AMPLITUDES:
            for diameter in DIAMETERS:
                results = {
                    name: trials(ground.xyz, screen, amplitude, diameter, untouched=untouched[name].argmax(axis=1))
                    for name, screen in methods.items()
                }
                table.append(_recall_row(ground, amplitude, diameter, results, main))
            say(f"{ground.name}: hazards of {amplitude} m done")
        table += _zone_rows(ground, untouched, main)
        if pictures is not None:
            _write(pictures, ground, methods, untouched)
    return table


def _write(
    folder: Path, ground: RealGround, methods: dict[str, Screening], untouched: dict[str, NDArray[np.floating]]
) -> None:
    """Pictures of the untouched cloud and of one with three hazards of 0.3 m and 3 m, and all zones as CSV."""
    from .screening_picture import draw

    scene = put_hazards(ground.xyz, [(0.3, 3.0), (-0.3, 3.0), (0.3, 3.0)], 0, site=SITE)
    moved = RealGround.of(ground.name, scene.xyz, ground.source)
    for name, screen in methods.items():
        stem = f"{ground.name.lower().replace(' ', '_')}_{name}"
        zones = shown_zones(ground, untouched[name])
        draw(folder / f"{stem}_untouched.png", ground, untouched[name], zones)
        after = screen(scene.xyz)
        draw(folder / f"{stem}_hazards.png", moved, after, shown_zones(moved, after), scene)
        lines = ["class,x,y,z,area_m2,points,height_over_trend_m,probability"]
        for zone in zones:
            x, y, z = zone.place
            lines.append(
                f"{CLASSES[zone.kind]},{x:.2f},{y:.2f},{z:.2f},{zone.area:.2f},{zone.points},{zone.height:.3f},"
                f"{zone.probability:.3f}"
            )
        (folder / f"{stem}_zones.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _ground_row(ground: RealGround) -> Row:
    description = json.loads(SHIPPED_WEIGHTS.with_suffix(".json").read_text(encoding="utf-8"))
    low, high = description["configuration"]["density"]
    rooms = ", ".join(f"{room_for(ground.xyz, diameter, SITE):.0f} m² for {diameter:g} m" for diameter in DIAMETERS)
    return Row(
        f"{ground.name}, ground ({ground.source})",
        f"{len(ground.xyz)} points on {ground.area:.0f} m², median {ground.density:.0f} a m², dip {ground.dip:.0f}°",
        "",
        f"the model is made for {low:g} to {high:g} a m²; room for middles of hazards: {rooms}",
    )


def _relief_row(ground: RealGround) -> Row:
    """What the slope's own bulges and hollows would pass for."""
    measured = [m for m in (own_relief(ground.xyz, diameter, SITE) for diameter in DIAMETERS) if len(m.heights)]
    heights = ", ".join(f"±{m.spread:.2f} m for {m.diameter:g} m" for m in measured)
    known = ", ".join(f"{100 * m.standing_out(0.3, FALSE):.0f} % of {m.diameter:g} m" for m in measured)
    return Row(
        f"{ground.name}, own relief in the shape of hazards",
        heights,
        "",
        f"distinguished by height at known places and {100 * FALSE:.0f} % false ones, hazards of 30 cm: {known}",
    )


def _recall_row(
    ground: RealGround, amplitude: float, diameter: float, results: dict[str, list[Trial]], main: str
) -> Row:
    name = f"{ground.name}, hazards of {100 * amplitude:.0f} cm and {diameter:g} m found"
    if not results[main]:
        return Row(name, "no room for any")
    texts = {}
    for method, found in results.items():
        share, before = recall(found)
        texts[method] = f"{method}: {100 * share:.0f} % of {len(found)} (shown without them: {100 * before:.0f} %)"
    wanted = (amplitude, diameter) == (0.30, 3.0)
    return Row(
        name,
        texts[main],
        f">= {100 * TARGET:.0f} %" if wanted else "",
        "; ".join(text for method, text in texts.items() if method != main),
        recall(results[main])[0] >= TARGET if wanted else None,
    )


def _zone_rows(ground: RealGround, untouched: dict[str, NDArray[np.floating]], main: str) -> list[Row]:
    """How much is shown of the untouched cloud by each method, and the main one's largest zones."""
    zones = {name: shown_zones(ground, probabilities) for name, probabilities in untouched.items()}
    texts = {}
    for name, found in zones.items():
        share = float(np.mean(untouched[name].argmax(axis=1) > 0))
        per = 1000 * len(found) / ground.area
        texts[name] = f"{name}: {len(found)} zones, {per:.0f} per 1,000 m², {100 * share:.0f} % of the points"
    others = "; ".join(text for name, text in texts.items() if name != main)
    listed = [
        Row(
            f"{ground.name}, untouched, zone {number} of {main}",
            f"{CLASSES[zone.kind]}, {zone.area:.1f} m², {zone.points} points, {zone.height:+.2f} m over the trend",
            "",
            "at {:.1f}, {:.1f}, {:.1f}; mean probability ".format(*zone.place) + f"{zone.probability:.2f}",
        )
        for number, zone in enumerate(zones[main][:LISTED], 1)
    ]
    return [Row(f"{ground.name}, untouched, zones shown", texts[main], "", others), *listed]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--weights", type=Path, help="of the network; the shipped ones by default")
    parser.add_argument("--pictures", type=Path, help="folder for pictures of the zones")
    given = parser.parse_args(arguments)
    if given.pictures is not None:
        given.pictures.mkdir(parents=True, exist_ok=True)
    table = rows(given.weights, given.pictures)
    print(heading())
    print(markdown("Screening of real slopes", table))
    return int(any(row.met is False for row in table))


if __name__ == "__main__":
    sys.exit(main())
