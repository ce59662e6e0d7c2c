"""Whether a change of the code that should change no result changes none.

``reference_set.py make FOLDER`` runs all commands on small simulated surveys and writes FOLDER/figures.json: a checksum
of every raster band, point dimension, table, layer and picture, and every figure of the run records. What differs
between two runs by nature (times, paths, run ids, versions) is left out. ``reference_set.py compare BEFORE AFTER``
names what differs and ends with 1. The surveys are made once and kept in FOLDER/surveys, of which another FOLDER can
have a copy. SLOPEWATCH_COMMAND names the module of an older command line.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import geopandas as gpd
import laspy
import matplotlib.image
import numpy as np
import pyogrio
import rasterio

ENGINE = [sys.executable, "-m", os.environ.get("SLOPEWATCH_COMMAND", "slopewatch.cli")]
VOLATILE = re.compile(
    r"(?i)(^|[_/])(started|seconds|run_id|path|versions?|software|sha256|bytes|peak_memory_mb|report)($|/)"
)
DATES = ("2024-05-01", "2025-05-01")


def run(*arguments: str | Path) -> None:
    """One command of the engine; raises ``subprocess.CalledProcessError`` where it fails."""
    print("slopewatch", *arguments, flush=True)
    subprocess.run([*ENGINE, *map(str, arguments), "--progress", "none"], check=True, stdout=subprocess.DEVNULL)


def make_surveys(folder: Path) -> None:
    size = ("--points", "150000", "--length", "30", "--height", "14")
    run("simulate", "survey", "--output-dir", folder / "pair", *size, "--seed", "21")
    run("simulate", "series", "--output-dir", folder / "series", *size, "--seed", "22", "--surveys", "4")
    run(
        "simulate",
        "scenes",
        "--output-dir",
        folder / "scenes",
        "--count",
        "3",
        "--area",
        "500",
        "--density",
        "40",
        "--seed",
        "23",
    )


def run_commands(surveys: Path, results: Path) -> None:
    for name in ("ground", "register", "m3c2", "screen"):
        (results / name).mkdir(parents=True, exist_ok=True)
    first, second = (surveys / "pair" / f"{date}.laz" for date in DATES)
    roi = ("--roi", surveys / "pair" / "roi.gpkg")
    epochs = ("--epoch", f"{DATES[0]}={first}", "--epoch", f"{DATES[1]}={second}")
    run("inspect", *epochs, *roi, "--output-dir", results / "inspect")
    run("inspect", *epochs, *roi, "--output-dir", results / "paper", "--profile", "paper")
    grounds = [results / "inspect" / "clouds" / f"{date}_ground.laz" for date in DATES]
    run("ground", first, *roi, "--output", results / "ground" / f"{DATES[0]}_ground.laz")
    aligned, transform = (results / "register" / name for name in ("aligned.laz", "transform.json"))
    run("register", *grounds, "--output", aligned, "--transform", transform)
    days = ("--epoch-from", DATES[0], "--epoch-to", DATES[1])
    change = ("change", grounds[0], aligned, *days)
    run(*change, "--output-dir", results / "change")
    run(*change, "--output-dir", results / "one_size", "--cell", "0.25", "--no-adaptive")
    run("m3c2", grounds[0], aligned, *days, "--output", results / "m3c2" / "cores.laz")
    run("screen", grounds[1], "--output", results / "screen" / "relief.laz")
    run("screen", grounds[1], "--output", results / "screen" / "network.laz", "--method", "network")
    run("screen", grounds[1], "--output", results / "screen" / "residual.laz", "--method", "residual")
    run("series", surveys / "series", "--output-dir", results / "series")
    scenes = sorted((surveys / "scenes").glob("*.laz"))
    run(
        *("train", *scenes, "--dimension", "truth_class", "--start", "none", "--network", "smoke", "--steps", "20"),
        *("--folds", "3", "--threads", "1", "--output-dir", results / "train"),
    )


def digest(array: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()[:16]


def figures_of(path: Path) -> Iterator[tuple[str, Any]]:
    """The figures and checksums of one file, each with its name; nothing for files that are only pictures of others."""
    kind = path.suffix.lower()
    if kind in (".laz", ".las"):
        cloud = laspy.read(path)
        yield "points", len(cloud.points)
        yield from ((name, digest(np.asarray(cloud[name]))) for name in cloud.point_format.dimension_names)
    elif kind == ".tif":
        with rasterio.open(path) as raster:
            yield "grid", [raster.width, raster.height, *raster.transform]
            yield from ((f"band {number}", digest(raster.read(number))) for number in raster.indexes)
    elif kind == ".gpkg":
        for layer, _ in pyogrio.list_layers(path):
            table = gpd.read_file(path, layer=layer)
            kept = [name for name in table.columns if not VOLATILE.search(name)]
            text = (table[kept].to_wkt() if "geometry" in kept else table[kept]).to_csv()
            yield layer, hashlib.sha256(text.encode()).hexdigest()[:16]
    elif kind == ".png":
        yield "pixels", digest(matplotlib.image.imread(path))
    elif kind == ".json":
        yield from flattened(json.loads(path.read_text(encoding="utf-8")))
    elif kind == ".csv":
        yield "text", hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    elif kind == ".safetensors":
        yield "bytes", hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def flattened(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves of a JSON document by their path; what differs by nature is left out."""
    if VOLATILE.search(name):
        return
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from flattened(inner, f"{name}/{key}")
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            yield from flattened(inner, f"{name}/{number}")
    elif not (isinstance(value, str) and ("/" in value or "\\" in value)):
        yield name, value


def make(folder: Path) -> None:
    surveys, results = folder / "surveys", folder / "results"
    if not surveys.exists():
        make_surveys(surveys)
    run_commands(surveys, results)
    figures = {}
    for path in sorted(p for p in results.rglob("*") if p.is_file()):
        for name, value in figures_of(path):
            figures[f"{path.relative_to(results)}: {name}"] = value
    (folder / "figures.json").write_text(json.dumps(figures, indent=1), encoding="utf-8")
    print(f"{len(figures)} figures in {folder / 'figures.json'}")


def compare(before: Path, after: Path) -> int:
    old, new = (json.loads((folder / "figures.json").read_text(encoding="utf-8")) for folder in (before, after))
    differing = sorted(key for key in old.keys() | new.keys() if old.get(key) != new.get(key))
    for key in differing:
        print(f"{key}: {old.get(key, 'missing')} before, {new.get(key, 'missing')} after")
    print(f"{len(differing)} of {len(old.keys() | new.keys())} figures differ")
    return int(bool(differing))


def main(arguments: list[str]) -> int:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if len(arguments) == 2 and arguments[0] == "make":
        make(Path(arguments[1]))
        return 0
    if len(arguments) == 3 and arguments[0] == "compare":
        return compare(Path(arguments[1]), Path(arguments[2]))
    print(__doc__, file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
