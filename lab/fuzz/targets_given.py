"""Files that are given to a command next to the clouds: roads, classes, names, settings, flights, models, labels."""

from __future__ import annotations

import json
import multiprocessing
import shutil
from pathlib import Path

import geopandas
import laspy
import numpy as np
import rasterio
import shapely
from pyproj import CRS
from slopewatch.lab.fuzz import mutations
from slopewatch.lab.fuzz.target import Target, sound
from slopewatch.tests.builders import copc_file, elevation_models, epoch_pairs, flights, label_studio

X, Y = epoch_pairs.X, epoch_pairs.Y


def targets(folder: Path, change: list[str]) -> list[Target]:
    """All of them, on sound files that are made in ``folder``.

    Args:
        change: words of a ``change`` between two clouds.
    """
    return [
        *_roads(folder, change),
        *_settings(folder, change),
        *_flights(folder),
        *_models(folder),
        *_labels(folder),
        Target("copc.laz", _copc(folder), mutations.changed_bytes, ("topview", "FILE", "--output-dir", "OUT/t")),
    ]


def centreline(path: Path) -> Path:
    """A road in two pieces, with chainages."""
    lines = [[(X - 5, Y - 3), (X + 5, Y - 2)], [(X + 5, Y - 2), (X + 20, Y - 4)]]
    shapes = [shapely.LineString(line) for line in lines]
    ends = [0.0, *np.cumsum([shape.length for shape in shapes])]
    values = {"route": ["G7"] * 2, "chain_from": ends[:2], "chain_to": ends[1:]}
    geopandas.GeoDataFrame(values, geometry=shapes, crs=32651).to_file(path)
    return path


def places(path: Path) -> Path:
    """Zones, a line and no shape, as somebody keeps them."""
    shapes = [shapely.box(X + 1, Y + 1, X + 3, Y + 4), shapely.box(X + 6, Y + 2, X + 9, Y + 5), None]
    values = {"zone_id": ["Z1", "Z2", "Z3"], "note": ["a", "é", None], "route": ["", "", "B1"]}
    geopandas.GeoDataFrame(values, geometry=shapes, crs=32651).to_file(path, layer="zones")
    return path


def classes(path: Path) -> Path:
    """Two classes of asset."""
    shapes = [shapely.box(X, Y, X + 6, Y + 12), shapely.box(X + 6, Y, X + 12, Y + 12)]
    geopandas.GeoDataFrame({"class": ["bench", "drain"]}, geometry=shapes, crs=32651).to_file(path)
    return path


def names(folder: Path) -> list[Path]:
    """Field names as JSON and as CSV, of a centreline with the fields of ``centreline``."""
    agreed = {"route": "ROAD_NO", "side": "SIDE", "zones": {"chainage": "CH"}, "centreline.chain_from": "chain_from"}
    (folder / "names.json").write_text(json.dumps({**agreed, "centreline": {"route": "route"}}), encoding="utf-8")
    rows = ["table,ours,theirs", "centreline,route,route", "zones,chainage,CH", ",side,SIDE"]
    (folder / "names.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return [folder / "names.json", folder / "names.csv"]


def _roads(folder: Path, change: list[str]) -> list[Target]:
    road, layer, assets = centreline(folder / "road.gpkg"), places(folder / "places.gpkg"), classes(folder / "a.gpkg")
    words = ("--output", "OUT/located.gpkg")
    found = [
        Target(
            f"centreline.{path.suffix[1:]}", path, mutation, ("locate", str(layer), "--centreline", "FILE", *words)
        )
        for path, mutation in (
            (road, mutations.changed_database), (centreline(folder / "road.geojson"), mutations.changed_json),
        )
    ]  # fmt: skip
    found.append(
        Target("layer", layer, mutations.changed_database, ("locate", "FILE", "--centreline", str(road), *words))
    )
    for path, mutation in zip(names(folder), (mutations.changed_json, mutations.changed_table), strict=True):
        given = ("locate", str(layer), "--centreline", str(road), "--field-names", "FILE", *words)
        found.append(Target(path.name, path, mutation, given, named=(road.name,)))
    summed = (*change, "--classes", "FILE", "--output-dir", "OUT/c")
    return [*found, Target("classes", assets, mutations.changed_database, summed)]


def settings(folder: Path) -> list[Path]:
    """Settings of a change as JSON and as TOML."""
    values = {"cell": 0.5, "zone_profiles": 0, "minimum_area": 2.0, "confidence": 0.9, "direction": "vertical"}
    path, toml = folder / "settings.json", folder / "settings.toml"
    path.write_text(json.dumps(values), encoding="utf-8")
    toml.write_text("".join(f"{name} = {json.dumps(value)}\n" for name, value in values.items()), encoding="utf-8")
    return [path, toml]


def corridor(folder: Path, clouds: list[Path]) -> list[Path]:
    """A manifest of a slope as a table and as a layer, and a file that describes a cluster."""
    table, layer, cluster = (folder / name for name in ("corridor.csv", "corridor.gpkg", "cluster.json"))
    days = ["2024-05-01", "2025-05-01"]
    rows = [f"S1,{day},{path},0.5" for day, path in zip(days, clouds, strict=True)]
    table.write_text("slope,date,file,cell\n" + "\n".join(rows) + "\n", encoding="utf-8")
    values = {"slope": ["S1"] * 2, "date": days, "file": [str(path) for path in clouds]}
    geopandas.GeoDataFrame(values, geometry=[shapely.box(X, Y, X + 12, Y + 12)] * 2, crs=32651).to_file(layer)
    described = {"cluster": "slurm", "jobs": 2, "options": {"cores": 1, "memory": "8GB"}}
    cluster.write_text(json.dumps(described), encoding="utf-8")
    return [table, layer, cluster]


def _settings(folder: Path, change: list[str]) -> list[Target]:
    path, toml = settings(folder)
    record = folder / "former" / "run.json"
    if not record.exists():
        sound(folder / "former", *change, "--output-dir", str(folder / "former"))
    kept = folder / "former.json"
    shutil.copy(record, kept)
    words = ("change", *change[1:3], "--settings", "FILE", "--output-dir", "OUT/c")
    coarse = (*change, "--settings", "FILE", "--output-dir", "OUT/c")
    return [
        Target("settings.json", path, mutations.changed_json, words),
        Target("settings.toml", toml, mutations.changed_bytes, words),
        Target("settings.record", kept, mutations.changed_json, coarse),
    ]


def flown(path: Path) -> Path:
    """A survey of ``flights.inclined`` in two strips, with times and scan angles; all of it is ground."""
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, 40, (2, 8000))
    strip = (y > 20).astype(int)
    las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    las.header.scales, las.header.offsets = [0.001] * 3, [flights.WEST, flights.NORTH, 100.0]
    las.header.add_crs(CRS.from_user_input(flights.CRS_CODE))
    las.x, las.y = flights.WEST + 50 + x, flights.NORTH - 80 + y
    las.z = 100.0 + 0.7 * (y + 40) + rng.normal(0, 0.01, len(x))
    las.gps_time = 100.0 * strip + x / 3.0
    las.scan_angle = np.degrees(np.arctan((y - 10 - 20 * strip) / 50.0)) / 0.006
    las.point_source_id = 1 + strip
    las.return_number[:], las.number_of_returns[:] = 1, 1
    las.classification[:] = 2
    las.write(path)
    return path


def trajectory(path: Path) -> Path:
    """Where the carrier was on two strips."""
    rows = ["time,x,y,z"]
    for strip in (0, 1):
        for t in np.arange(0.0, 14.0):
            rows.append(f"{100 * strip + t},{flights.WEST + 50 + 3 * t},{flights.NORTH - 70 + 20 * strip},195.0")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def _flights(folder: Path) -> list[Target]:
    terrain, region, plan = folder / "terrain.tif", folder / "slope.gpkg", folder / "plan"
    elevation_models.write_model(terrain, flights.inclined(relief=2.0).heights)
    flights.write_region(region, flights.square())
    quick = ("--pulse-rate", "4000", "--ground-share", "0.3")
    sound(plan, "planflight", str(terrain), "--roi", str(region), *quick, "--output-dir", str(plan))
    made, cloud, track = plan / "plan.gpkg", flown(folder / "flown.las"), trajectory(folder / "track.csv")
    out = ("--output-dir", "OUT/f")
    database = mutations.changed_database
    again = ("planflight", str(terrain), "--roi", str(region), "--plan", "FILE", *quick, *out)
    return [
        Target("plan.again", made, database, again),
        Target("plan.compared", made, database, ("compareflight", "FILE", str(cloud), *out)),
        Target("flown.las", cloud, mutations.changed_bytes, ("compareflight", str(made), "FILE", *out)),
        Target(
            "trajectory", track, mutations.changed_table,
            ("compareflight", str(made), str(cloud), "--trajectory", "FILE", *out),
        ),
        Target(
            "terrain.tif", terrain, mutations.changed_tags, ("planflight", "FILE", "--roi", str(region), *quick, *out)
        ),
    ]  # fmt: skip


def _models(folder: Path) -> list[Target]:
    """Of a plain grid, and of one that is turned by 20 degrees."""
    heights = elevation_models.hills(60, 70)
    first = elevation_models.write_model(folder / "2023-01-01.tif", heights)
    rng = np.random.default_rng(2)
    second = elevation_models.write_model(folder / "2024-01-01.tif", heights + rng.normal(0.1, 0.03, heights.shape))
    turned = elevation_models.write_turned(folder / "2025-01-01.tif", 20.0, (1.0, 0.8), (60, 90))
    words = ("demchange", str(first), "FILE", "--output-dir", "OUT/d")
    return [
        Target("dem.tif", second, mutations.changed_tags, words),
        Target("dem.turned.tif", turned, mutations.changed_tags, words),
    ]


def _labels(folder: Path) -> list[Target]:
    """A top view for Label Studio, its tasks, and what comes back."""
    picture, drawn, site = folder / "top_view.tif", folder / "drawn.gpkg", folder / "labelling"
    rgba = np.full((4, 40, 60), 200, np.uint8)
    profile = {"count": 4, "dtype": "uint8", "height": 40, "width": 60, "crs": "EPSG:32651", "photometric": "RGB"}
    with rasterio.open(
        picture, "w", driver="GTiff", transform=rasterio.Affine(0.2, 0, X, 0, -0.2, Y + 12), **profile
    ) as target:
        target.write(rgba)
    shapes = [shapely.box(X + 1, Y + 5, X + 3, Y + 8), shapely.box(X + 6, Y + 6, X + 9, Y + 9)]
    geopandas.GeoDataFrame({"class": ["uplift", "subsidence"]}, geometry=shapes, crs=32651).to_file(drawn)
    sound(
        site,
        "exportlabelstudio",
        str(picture),
        "--segments",
        str(drawn),
        "--label-field",
        "class",
        "--output-dir",
        str(site),
    )
    (made,) = json.loads((site / "tasks.json").read_text(encoding="utf-8"))
    mask = np.zeros((40, 60), bool)
    mask[10:20, 30:50] = True
    size = (60, 40)
    brush = {"format": "rle", "rle": label_studio.painted(mask), "brushlabels": ["uplift"]}
    square = {"x": 10.0, "y": 10.0, "width": 30.0, "height": 20.0, "rotation": 15, "rectanglelabels": ["crack"]}
    results = [
        label_studio.polygon([(5, 50), (30, 50), (20, 90)], "uplift", size, "r1"),
        label_studio.result("brushlabels", brush, size, "r2"),
        label_studio.result("rectanglelabels", square, size, "r3"),
    ]
    label_studio.write_export(site / "export.json", [label_studio.task(results, data=made["data"])])
    back = ("importlabelstudio", "FOLDER/export.json", "--tasks", "FOLDER/tasks.json", "--output", "OUT/l.gpkg")
    there = ("--output-dir", "OUT/l")
    return [
        Target("labels.export", site / "export.json", mutations.changed_json, back, site),
        Target("labels.tasks", site / "tasks.json", mutations.changed_json, back, site, named=("export.json",)),
        Target("labels.picture", site / "top_view.png", mutations.changed_bytes, back, site, named=("export.json",)),
        Target("top_view.tif", picture, mutations.changed_tags, ("exportlabelstudio", "FILE", *there)),
        Target(
            "segments", drawn, mutations.changed_database,
            ("exportlabelstudio", str(picture), "--segments", "FILE", "--label-field", "class", *there),
        ),
    ]  # fmt: skip


def _copc(folder: Path) -> Path:
    source, path = epoch_pairs.write(folder / "for_copc.laz", epoch_pairs.slope(5, 1500)), folder / "cloud.copc.laz"
    # in a process of its own: threads that lazrs starts here would be waited for in vain by all that are forked later
    made = multiprocessing.get_context("fork").Process(target=copc_file.write_copc, args=(source, path))
    made.start()
    made.join()
    if made.exitcode != 0:
        raise RuntimeError(f"{path} could not be made")
    return path
