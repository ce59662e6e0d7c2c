"""What is fuzzed: sound files of every kind, how each is changed, and the command that reads it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import geopandas
import numpy as np
import shapely
from slopewatch.engine.series.alerts import DEFAULT_TABLE
from slopewatch.lab.fuzz import mutations, targets_given, targets_results
from slopewatch.lab.fuzz.target import Target, sound
from slopewatch.tests.builders import epoch_pairs, screening_clouds

COARSE = ("--cell", "0.5", "--zone-profiles", "0")


def all_targets(folder: Path) -> list[Target]:
    """All targets, on sound files that are made in ``folder``.

    Raises:
        RuntimeError: a command fails on a sound file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    clouds = []
    for n, sunk in ((1, 0.0), (2, 0.3)):
        xyz = epoch_pairs.slope(n, 4000)
        xyz[xyz[:, 0] < epoch_pairs.X + 4, 2] -= sunk
        clouds.append(epoch_pairs.write(folder / f"{2023 + n}-05-01.laz", xyz))
    plain = epoch_pairs.write(folder / "plain.las", epoch_pairs.slope(3, 500))
    change = ["change", *map(str, clouds), *COARSE]
    return [
        Target("las", plain, mutations.changed_bytes, ("info", "FILE")),
        Target("laz", clouds[0], mutations.changed_bytes, ("info", "FILE")),
        *_clipped(folder),
        *_areas(folder, change),
        *_series(folder, clouds),
        *_transforms(folder, clouds, change),
        *_folders(folder, clouds, change),
        *_weights(folder),
        *targets_given.targets(folder, change),
        *targets_results.targets(folder, clouds),
    ]


def _clipped(folder: Path) -> list[Target]:
    """Raw clouds that PDAL reads and clips to a region, by their own reference system and by a given one."""
    region = folder / "region.gpkg"
    square = shapely.box(epoch_pairs.X + 1, epoch_pairs.Y + 1, epoch_pairs.X + 11, epoch_pairs.Y + 11)
    geopandas.GeoDataFrame(geometry=[square], crs=32651).to_file(region)
    words = ("ground", "FILE", "--roi", str(region), "--output", "OUT/g.laz")
    found = []
    for ending in ("las", "laz"):
        cloud = epoch_pairs.write(folder / f"raw.{ending}", epoch_pairs.slope(4, 4000))
        for kind, given in (("own", ()), ("given", ("--crs", "EPSG:32651"))):
            found.append(Target(f"clipped.{kind}.{ending}", cloud, mutations.changed_bytes, (*words, *given)))
    return found


def _areas(folder: Path, change: list[str]) -> list[Target]:
    stable = geopandas.GeoDataFrame(geometry=[shapely.box(500_000, 3_500_000, 500_012, 3_500_005)], crs=32651)
    found = []
    for ending, mutation in (("gpkg", mutations.changed_database), ("geojson", mutations.changed_json)):
        path = folder / f"stable.{ending}"
        stable.to_file(path)
        words = (*change, "--stable", "FILE", "--output-dir", "OUT/c")
        found.append(Target(f"area.{ending}", path, mutation, words))
    return found


def _series(folder: Path, clouds: list[Path]) -> list[Target]:
    manifest = folder / "surveys.csv"
    manifest.write_text("date,path\n" + "".join(f"{p.stem},{p}\n" for p in clouds), encoding="utf-8")
    series = ("--ground-ready", "--no-rasters-each-survey", "--cell", "0.5", "--method", "none")
    given = ("series", str(manifest), "--alerts", "FILE", *series, "--output-dir", "OUT/s")
    return [
        Target(
            "manifest",
            manifest,
            mutations.changed_table,
            ("series", "FILE", *series, "--output-dir", "OUT/s"),
            named=("survey",),
        ),
        Target("alerts", DEFAULT_TABLE, mutations.changed_table, given),
    ]


def _transforms(folder: Path, clouds: list[Path], change: list[str]) -> list[Target]:
    rigid, bent = folder / "transform.json", folder / "bent.json"
    first, second = map(str, clouds)
    sound(rigid, "register", first, second, "--output", str(folder / "aligned.laz"), "--transform", str(rigid))
    document = json.loads(rigid.read_text(encoding="utf-8"))
    corner = np.array(document["centre"][:2]) - 10
    nodes = {"west": corner[0], "south": corner[1], "spacing": 10.0}
    document["pieces"] = {
        "order": "after the matrix",
        **nodes, "heights": np.full((3, 3), 0.01).tolist(), "standard_errors": np.full((3, 3), 0.002).tolist(),
    }  # fmt: skip
    bent.write_text(json.dumps(document), encoding="utf-8")
    apply = ("register", first, second, "--apply", "FILE", "--output", "OUT/moved.laz")
    moved = (*change, "--transform", "FILE", "--output-dir", "OUT/c")
    return [
        Target("transform", rigid, mutations.changed_json, apply),
        Target("transform.bent", bent, mutations.changed_json, moved),
    ]


def _folders(folder: Path, clouds: list[Path], change: list[str]) -> list[Target]:
    """Output folders of which one file was changed, for ``report``."""
    made, series, one = (folder / name for name in ("changed", "watched", "screened"))
    line = geopandas.GeoDataFrame(
        {"name": ["a"]}, geometry=[shapely.LineString([(500_001, 3_500_001), (500_010, 3_500_010)])], crs=32651
    )
    line.to_file(folder / "lines.gpkg")
    sound(made, *change, "--profiles", str(folder / "lines.gpkg"), "--output-dir", str(made))
    ready = ("--ground-ready", "--no-rasters-each-survey", "--cell", "0.5", "--method", "none")
    sound(series, "series", *(f"--epoch={p.stem}={p}" for p in clouds), *ready, "--output-dir", str(series))
    raw = screening_clouds.write(folder / "2026-05-01.laz", screening_clouds.slope(9000))
    sound(one, "inspect", f"--epoch=2026-05-01={raw}", "--screening-method", "filter", "--output-dir", str(one))
    report, found = ("report", "FOLDER"), []
    for place in (made, series, one):
        found.append(Target(f"record.{place.name}", place / "run.json", mutations.changed_json, report, place))
    for name in ("elevation_change", "significant_change", "surface_heights", "point_counts"):
        found.append(Target(f"geotiff.{name}", made / f"{name}.tif", mutations.changed_tags, report, made))
    found.append(Target("zones.gpkg", made / "zones.gpkg", mutations.changed_database, report, made))
    found.append(Target("profiles.csv", made / "profiles.csv", mutations.changed_table, report, made))
    again = (*change, "--overwrite", "--output-dir", "FOLDER")
    found.append(Target("reviews.gpkg", made / "zones.gpkg", mutations.changed_database, again, made))
    shutil.copy(made / "run.json", folder / "run.json")
    lines = ("report", str(made), "--profiles", "FILE")
    found.append(Target("lines.gpkg", folder / "lines.gpkg", mutations.changed_database, lines))
    return found


def _weights(folder: Path) -> list[Target]:
    """Both kinds of weights and what describes them; none without torch."""
    try:
        import torch
        from slopewatch.models.network.relief_looks import UNetConfiguration
        from slopewatch.models.network.unet import UNet, save_unet
    except ImportError:
        return []
    torch.set_num_threads(1)
    points, relief = folder / "points", folder / "relief"
    for place in (points, relief):
        place.mkdir(exist_ok=True)
    screening_clouds.small_weights(points / "model.safetensors")
    torch.manual_seed(5)
    save_unet(relief / "model.safetensors", UNet(UNetConfiguration(widths=(4, 6, 8))).eval(), {}, {})
    cloud = screening_clouds.write(folder / "screen.laz", screening_clouds.slope(12_000))
    words = ("screen", str(cloud), "--weights", "FOLDER/model.safetensors", "--threads", "1", "--output", "OUT/l.laz")
    found = []
    for place in (points, relief):
        json_file, weights = place / "model.json", place / "model.safetensors"
        found.append(Target(f"model.{place.name}", json_file, mutations.changed_json, words, place))
        changed = mutations.changed_safetensors
        found.append(Target(f"weights.{place.name}", weights, changed, words, place, "model.json"))
    return found
