"""Whether the densities of real flights are those that the plan's closed form promises of their ways.

    .venv/bin/python lab/trials/real_flight_trial.py FOLDER_WITH_CLOUDS FOLDER

No real cloud at hand comes with its flying parameters, so the way is that of the scan angles, as `compareflight` finds
it, and the pulses a second and radian are counted in the cloud. What is compared then is the geometry: distance, speed,
inclination of the ground. Ground returns are promised with the plants that another strip of the same cloud saw. For the
level, the pulses of the strip are dealt into two halves at random, which are compared by `change` as two surveys.
"""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np
import shapely
from slopewatch import api
from slopewatch.engine.flight.flown_tracks import Track, track_from_angles
from slopewatch.engine.flight.last_survey import Seen, even_scatter, scatter_within, seen_by
from slopewatch.engine.flight.lines import Line
from slopewatch.engine.flight.plan import expected_of, place_grid
from slopewatch.engine.flight.terrain import Terrain, terrain_of_points
from slopewatch.engine.grid.geotiff import read_raster
from slopewatch.engine.grid.grid import cell_index
from slopewatch.engine.pointcloud.reading import read_cloud, read_return_numbers
from slopewatch.engine.pointcloud.times import Flown, read_flown
from slopewatch.interface.parameters import FlightParameters

RIM_M = 15.0  # of a strip that is not judged
STEP_S = 0.25
PLACE_M = 5.0
FLIGHTS = (
    ("british_columbia_forest.laz", 67, 68),
    ("british_columbia_forest.laz", 68, 67),
    ("santa_cruz_gullies.laz", 8706, 8707),
)
"""Cloud, strip that is compared, and strip that serves as the last survey."""


@dataclass(frozen=True)
class Way:
    """A straight flight: place (3,) at the time ``middle``, velocity (3,) m/s."""

    place: np.ndarray
    velocity: np.ndarray
    middle: float

    @property
    def speed(self) -> float:
        return float(np.hypot(*self.velocity[:2]))

    def at(self, seconds: np.ndarray) -> np.ndarray:
        return self.place + (seconds - self.middle)[:, None] * self.velocity


def straight(track: Track) -> Way:
    middle = float(track.seconds.mean())
    velocity, place = np.polyfit(track.seconds - middle, track.xyz, 1)
    return Way(place, velocity, middle)


def pulses_a_radian(xyz: np.ndarray, seconds: np.ndarray, way: Way, inner: shapely.Geometry) -> tuple[float, float]:
    """Pulses a second and radian of the first returns, by the angle that each has from the fitted way, counted where
    the ground lies within ``inner`` all along a quarter of a second and half a degree; and the widest such angle (rad).
    """
    start, end = seconds.min(), seconds.max()
    across = np.array([way.velocity[1], -way.velocity[0]]) / way.speed
    # time and angle of each return follow from its place, not from the file's rounded angles
    relative = xyz - way.at(seconds)
    angle = np.arctan2(relative[:, :2] @ across, -relative[:, 2])
    ground = float(np.median(xyz[:, 2]))
    times, angles = np.arange(start, end, STEP_S), np.radians(np.arange(-40, 40, 0.5))
    edges = (np.append(times, times[-1] + STEP_S), np.append(angles, angles[-1] + math.radians(0.5)))
    counts, *_ = np.histogram2d(seconds, angle, edges)
    inside = np.ones(counts.shape, dtype=bool)
    for dt in (0.0, STEP_S):
        for da in (0.0, math.radians(0.5)):
            carrier = way.at(times + dt)
            reach = np.tan(angles + da)[None, :] * (carrier[:, 2] - ground)[:, None]
            x = carrier[:, 0][:, None] + reach * across[0]
            y = carrier[:, 1][:, None] + reach * across[1]
            inside &= shapely.contains_xy(inner, x, y)
    found = counts[inside]
    widest = float(np.abs(angles[np.nonzero(inside)[1]]).max())
    return float(found.sum() / (inside.sum() * STEP_S * math.radians(0.5))), widest


def line_of(way: Way, seconds: np.ndarray, terrain: Terrain) -> Line:
    """The way as one flight line, longer by two seconds at both ends."""
    times = np.linspace(seconds.min() - 2.0, seconds.max() + 2.0, 200)
    track = way.at(times)
    ground = np.nan_to_num(terrain.at(track[:, :2]), nan=float(np.nanmedian(terrain.heights)))
    return Line(1, track[[0, -1]], ground[[0, -1]], track, ground)


def run_flight(path: Path, strip: int, last: int, folder: Path) -> dict[str, object]:
    """Figures of one strip, promised and found."""
    folder.mkdir(parents=True, exist_ok=True)
    cloud, flown = read_cloud(path), read_flown(path)
    first, is_ground = read_return_numbers(path) == 1, cloud.classification == 2
    if not is_ground.any():
        is_ground = np.ones(len(first), dtype=bool)  # a cloud of ground alone
    own, earlier = flown.source == strip, flown.source == last
    track = track_from_angles(cloud.xyz[own], flown.seconds[own], flown.angle[own])
    if track is None:  # angles counted to the left
        track = track_from_angles(cloud.xyz[own], flown.seconds[own], -flown.angle[own])
    assert track is not None
    way = straight(track)
    terrain = terrain_of_points(cloud.xyz[is_ground], cloud.crs, path, 10.0)
    inner = _hull(cloud.xyz[own & first])
    rate, _ = pulses_a_radian(cloud.xyz[own & first], flown.seconds[own & first], way, inner)
    region = inner.intersection(_hull(cloud.xyz[earlier & first]))
    line = line_of(way, flown.seconds[own], terrain)
    # only the ratio of rate and speed matters, and speeds of aircraft are beyond the parameter's bounds
    wide = math.radians(80.0)
    scatter = scatter_within(cloud.xyz[earlier & is_ground], region) or even_scatter(None)
    found: dict[str, object] = {
        "cloud": path.name,
        "strip": strip,
        "height_m": float(np.median(track.xyz[:, 2]) - np.median(cloud.xyz[own, 2])),
        "speed_m_s": way.speed,
        "pulses_s": rate * wide,
        "area_m2": region.area,
    }
    for half in (False, True):
        parameters = FlightParameters(
            pulse_rate=rate * wide / 4.0 / (2.0 if half else 1.0), flying_speed=way.speed / 4.0, field_of_view=80.0,
            altitude=1000.0, place_size=PLACE_M, battery_time=600.0, expected_registration_error=0.0,
        )  # fmt: skip
        grid = place_grid(region, parameters)
        seen: Seen = seen_by(grid, cloud.xyz[earlier & first], cloud.xyz[earlier & is_ground], int(earlier.sum()))
        expected = expected_of(region, terrain, [line], seen, scatter, parameters).expected
        whole = _whole(region, grid) & expected.inside
        if not half:
            # without plants: the share of pulses that reach the ground is set to one
            bare = replace(parameters, ground_share=1.0)
            pulses = expected_of(region, terrain, [line], seen, scatter, bare).expected.ground
            for name, chosen, promised in (
                ("pulses", own & first, pulses),
                ("ground", own & is_ground, expected.ground),
            ):
                reached = _density(cloud.xyz[chosen], grid)[whole]
                wanted = promised[whole]
                found[f"{name}_promised"] = float(wanted.mean())
                found[f"{name}_found"] = float(reached.mean())
                found[f"{name}_ratio"] = float(reached.mean() / wanted.mean())
            found["places"] = int(whole.sum())
        else:
            found |= _level(path, flown, own & is_ground, folder, expected.level[whole], region)
    return found


def _level(
    path: Path, flown: Flown, ground: np.ndarray, folder: Path, promised: np.ndarray, region: shapely.Geometry
) -> dict[str, object]:
    """The level of two random halves of a strip's pulses, as `change` computes it."""
    las = laspy.read(path)
    _, pulse = np.unique(flown.seconds, return_inverse=True)
    side = np.random.default_rng(5).integers(0, 2, pulse.max() + 1)[pulse]
    halves = []
    for number in (0, 1):
        part = laspy.LasData(las.header)
        part.points = las.points[ground & (side == number)].copy()
        name = folder / f"half{number}.laz"
        part.write(name)
        halves.append(name)
    api.change(*halves, folder / "change", dates=("2020-01-01", "2020-02-01"), overwrite=True, trust_dates=True)
    level = read_raster(folder / "change" / "level_of_detection.tif")
    rows, columns = np.nonzero(np.isfinite(level.array))
    x = level.grid.west + (columns + 0.5) * level.grid.cell
    y = level.grid.north - (rows + 0.5) * level.grid.cell
    inside = shapely.contains_xy(region, x, y)
    record = json.loads((folder / "change" / "run.json").read_text(encoding="utf-8"))
    reached = float(np.median(level.array[rows[inside], columns[inside]]))
    return {
        "level_promised": float(np.nanmedian(promised)),
        "level_found": reached,
        "level_ratio": reached / float(np.nanmedian(promised)),
        "cell": record.get("cell", {}).get("cell_m"),
        "registration_error": record["metrics"].get("registration_error_m"),
    }


def _hull(xyz: np.ndarray) -> shapely.Geometry:
    return shapely.concave_hull(shapely.multipoints(xyz[:: max(1, len(xyz) // 20000), :2]), ratio=0.1).buffer(-RIM_M)


def _whole(region: shapely.Geometry, grid) -> np.ndarray:  # type: ignore[no-untyped-def]
    rows, columns = np.indices(grid.shape)
    west, north = grid.west + columns * grid.cell, grid.north - rows * grid.cell
    return np.asarray(shapely.contains(region, shapely.box(west, north - grid.cell, west + grid.cell, north)))


def _density(xyz: np.ndarray, grid) -> np.ndarray:  # type: ignore[no-untyped-def]
    place = cell_index(xyz, grid)
    return np.bincount(place[place >= 0], minlength=grid.rows * grid.columns).reshape(grid.shape) / grid.cell**2


if __name__ == "__main__":
    clouds, out = Path(sys.argv[1]), Path(sys.argv[2])
    for cloud_name, strip_number, last_number in FLIGHTS:
        made = run_flight(clouds / cloud_name, strip_number, last_number, out / f"{strip_number}")
        print(json.dumps(made, indent=1), flush=True)
