"""What a finished run's folder holds that can be handed over, by its record."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import geopandas as gpd
import numpy as np
import pandas as pd
import pyogrio
import shapely
from pyproj import CRS

from ...interface.input_files import PART, RASTER, RECORD, RUN_TABLE
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.gdal_names import readable
from ..core.input_files import check_input, open_input, read_input
from ..core.json_shapes import anything, fields, moment, number, parse_json, read_json, rows, table, text
from ..core.messages import shown
from ..core.part_folders import settle_around
from ..grid.geotiff import Raster, open_any_grid, read_raster
from ..report.record_shape import inside
from ..vector.geopackage import read_layer

COMMANDS = (
    "inspect", "change", "series", "screen", "displacement", "demchange", "batch", "m3c2", "locate", "planflight",
    "compareflight",
)  # fmt: skip
"""Whose results can be handed over."""
_MOST_NANOSECONDS = 2**63
_RECORD = fields(
    {"command": text(), "outputs": table(text())},
    {
        "software": text(), "started": moment, "run_id": text(), "metrics": fields({}), "warnings": rows(text()),
        "inputs": rows(fields({"role": text()}, {"path": text(), "sha256": text()})),
        "parameters": table(table(anything)), "versions": table(text()), "dates": rows(text()),
        "tables_stamp": rows(number(0, _MOST_NANOSECONDS, whole=True)),
    },
)  # fmt: skip
_NO_RECORD = "{path} is no run record that can be read ({why}); give the folder of a finished run."
_SURFACES, _SECTIONS = "surface_heights", "profiles_table"
_STRAIGHT_M = 0.002
"""A section's points within this of a straight line are on it: those of a table have three decimals."""
_PICTURES = ("heatmap", "series_picture", "map", "screened_map", "picture")


@dataclass(frozen=True)
class HeldLayer:
    """A layer of the folder: its ``name`` in the hand-over, its table, and its QGIS style (empty: none)."""

    name: str
    frame: gpd.GeoDataFrame | pd.DataFrame
    qml: str

    @property
    def places(self) -> gpd.GeoDataFrame | None:
        """The table with its places; None for one without."""
        return self.frame if isinstance(self.frame, gpd.GeoDataFrame) else None


@dataclass(frozen=True)
class Section:
    """Heights (m) of both surveys along a line over the ground: ``xy`` (n, 2), NaN where one is not known."""

    name: str
    xy: Float
    distance: Float
    earlier: Float
    later: Float

    @property
    def bends(self) -> Float:
        """The line (m, 2) that the points lie on: its ends, and where it changes its direction."""
        return shapely.get_coordinates(shapely.simplify(shapely.LineString(self.xy), _STRAIGHT_M))


def stretches(heights: Float) -> list[slice]:
    """Where heights (n,) are known without a gap, over two points or more."""
    known = np.concatenate([[False], np.isfinite(heights), [False]])
    edges = np.flatnonzero(known[1:] != known[:-1]).reshape(-1, 2)
    return [slice(int(first), int(after)) for first, after in edges if after - first > 1]


@dataclass(frozen=True)
class Held:
    """Files by the name that they have in the hand-over, layers, and what the record says.

    ``surfaces`` are rasters of ground heights by name, the later survey's last; ``days`` those of the surveys.
    """

    folder: Path
    record: Mapping[str, Any]
    rasters: Mapping[str, Path]
    tables: Mapping[str, Path]
    pages: Mapping[str, Path]
    clouds: Mapping[str, Path]
    layers: tuple[HeldLayer, ...]
    surfaces: Mapping[str, Raster]
    sections: tuple[Section, ...]
    crs: CRS | None
    days: tuple[date, ...]

    @property
    def zones(self) -> tuple[HeldLayer, ...]:
        """Layers of polygons that are zones."""
        return tuple(layer for layer in self.layers if layer.name.endswith("zones") and layer.places is not None)

    def missing(self) -> list[str]:
        """Words for what a reader may look for and this folder does not hold."""
        found = {
            "zones": any(len(layer.frame) for layer in self.zones),
            "ground surfaces": bool(self.surfaces),
            "sections": bool(self.sections),
            "rasters": bool(self.rasters),
        }
        return [name for name, there in found.items() if not there]


def find_record(run: Path) -> Path:
    """The record of a finished run: the file itself, or that of its folder.

    Raises:
        InputError: there is none, or more than one.
    """
    settle_around(run)
    if run.is_file():
        return run
    if not run.is_dir():
        raise InputError(f"{shown(run)} does not exist; give the output folder of a run.")
    if (run / "run.json").is_file():
        return run / "run.json"
    found = [path for path in sorted(run.glob("*_run.json")) if _command(path) in COMMANDS]
    if len(found) > 1:
        raise InputError(
            f"{shown(run)} holds {len(found)} runs; give the record of one of them, such as {found[0].name}."
        )
    if not found:
        raise InputError(f"{shown(run)} holds no run.json, so no finished run; let it end, or give another folder.")
    return found[0]


def _command(record: Path) -> str:
    """The command of a run record; empty where it cannot be read."""
    try:
        document = parse_json(read_input(record, RECORD))
    except (InputError, ValueError):
        return ""
    return str(document.get("command", "")) if isinstance(document, dict) else ""


def read_record(path: Path) -> dict[str, Any]:
    """A run record.

    Raises:
        InputError: it is damaged, or of a command whose results cannot be handed over.
    """
    record = dict(read_json(path, _RECORD, _NO_RECORD))
    if record["command"] not in COMMANDS:
        raise InputError(
            f"{shown(path)} is of the command {shown(record['command'])}, whose results are not handed over; give a "
            f"run of {', '.join(COMMANDS[:-1])} or {COMMANDS[-1]}."
        )
    return record


def read_held(run: Path) -> Held:
    """What the folder of a finished run holds.

    Raises:
        InputError: no finished run, or a file that its record names is missing or cannot be read.
    """
    record_path = find_record(run)
    record, folder = read_record(record_path), record_path.parent.absolute()
    files = {key: path for key, name in record["outputs"].items() if (path := inside(folder, name)) is not None}
    kept = _there(files, record["command"])
    layers = _layers(path for path in kept.values() if path.suffix == ".gpkg")
    rasters = {_name(path, folder): path for path in kept.values() if path.suffix in (".tif", ".vrt")}
    pages = [path for key, path in kept.items() if path.suffix in (".html", ".pdf") or key in _PICTURES]
    surfaces = _surfaces(kept[_SURFACES], record) if _SURFACES in kept else {}
    return Held(
        folder=folder,
        record=record,
        rasters=rasters,
        tables={_name(path, folder): path for path in kept.values() if path.suffix == ".csv"},
        pages={path.name: path for path in pages},
        clouds={_name(path, folder): path for path in files.values() if path.suffix in (".laz", ".las")},
        layers=layers,
        surfaces=surfaces,
        sections=read_sections(kept[_SECTIONS]) if _SECTIONS in kept else (),
        crs=_crs(layers, rasters.values()),
        days=_days(record),
    )


def check_files(record_path: Path) -> None:
    """Raise InputError if a run record cannot be used, or a file is gone that it names and that is handed over."""
    record, folder = read_record(record_path), record_path.parent.absolute()
    named = record["outputs"].items()
    _there({key: path for key, name in named if (path := inside(folder, name)) is not None}, record["command"])


def _there(files: Mapping[str, Path], command: str) -> dict[str, Path]:
    """The files of kinds that are handed over; clouds are looked at only where they are asked for."""
    kinds = (".tif", ".vrt", ".gpkg", ".csv", ".html", ".pdf", ".png")
    kept = {key: path for key, path in files.items() if path.suffix in kinds}
    lost = next((path for path in kept.values() if not path.is_file()), None)
    if lost is not None:
        raise InputError(
            f"{shown(lost.parent)} lacks {shown(lost.name)}, which its run record names; run {command} again, or put "
            "the file back."
        )
    for path in kept.values():
        check_input(path, RASTER if path.suffix == ".tif" else PART)
    return kept


def _name(path: Path, folder: Path) -> str:
    """A file's name in the hand-over, which is flat: of rasters of pairs and of the days, the folder is part of it."""
    parts = path.relative_to(folder).with_suffix("").parts
    return "_".join(part for part in parts if part != "clouds")


def _layers(packages: Iterable[Path]) -> tuple[HeldLayer, ...]:
    found: dict[str, HeldLayer] = {}
    for path in packages:
        try:
            with readable(path) as plain:
                names = [str(name) for name, _ in pyogrio.list_layers(plain) if name != "layer_styles"]
        except (RuntimeError, OSError, ValueError) as error:
            raise InputError(f"{shown(path)} cannot be read as a GeoPackage; run the command again.") from error
        styles = _styles(path)
        for layer in names:
            name = layer
            if name in found:
                name = path.stem if path.stem.endswith(layer) and path.stem not in found else f"{path.stem}_{layer}"
            found[name] = HeldLayer(name, read_layer(path, layer), styles.get(layer, ""))
    return tuple(found.values())


def _styles(package: Path) -> dict[str, str]:
    """The QGIS style of each layer that has one."""
    try:
        with closing(sqlite3.connect(f"{package.absolute().as_uri()}?mode=ro", uri=True)) as database:
            rows_found = database.execute("SELECT f_table_name, styleQML FROM layer_styles").fetchall()
    except sqlite3.Error:
        return {}
    styles = {str(name): str(qml) for name, qml in rows_found if qml}
    try:
        for qml in styles.values():
            ElementTree.fromstring(qml)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"{shown(package)} holds a style that cannot be read; run the command again.") from error
    return styles


def _surfaces(path: Path, record: Mapping[str, Any]) -> dict[str, Raster]:
    days = [one.get("name", "") for one in record.get("epochs") or ()]
    names = [
        f"ground {day}" if day else word for day, word in zip(days, ("ground earlier", "ground later"), strict=False)
    ]
    if len(set(names)) != 2:
        names = ["ground earlier", "ground later"]
    read = {name: read_raster(path, band) for band, name in enumerate(names, 1)}
    return {name: raster for name, raster in read.items() if np.isfinite(raster.array).any()}


def read_sections(path: Path) -> tuple[Section, ...]:
    """The sections of a table of profiles; InputError where it is none."""
    try:
        with open_input(path, RUN_TABLE) as stream:
            cells = pd.read_csv(stream)
        groups = [(str(name), cells_of) for name, cells_of in cells.groupby("profile", sort=False)]
        return tuple(_section(name, part) for name, part in groups if len(part) > 1)
    except (ValueError, KeyError, pd.errors.ParserError) as error:
        raise InputError(f"{shown(path)} is no table of profiles ({error}); make the report again.") from error


def _section(name: str, cells: pd.DataFrame) -> Section:
    columns = ("distance_m", "height_from_m", "height_to_m")
    distance, earlier, later = (cells[column].to_numpy(dtype=float) for column in columns)
    places = cells[["x", "y"]].to_numpy(dtype=float)
    if not (np.isfinite(places).all() and np.isfinite(distance).all()):
        raise ValueError(f"a place of {name} is no number")
    return Section(name, places, distance, earlier, later)


def _crs(layers: Iterable[HeldLayer], rasters: Iterable[Path]) -> CRS | None:
    """The reference system of the run's results: that of the first raster, which may have heights, else of a layer."""
    for path in rasters:
        if path.suffix == ".tif" and (crs := _raster_crs(path)) is not None:
            return crs
    return next((CRS.from_user_input(p.crs) for one in layers if (p := one.places) is not None and p.crs), None)


def _raster_crs(path: Path) -> CRS | None:
    with open_any_grid(path) as source:
        return CRS.from_wkt(source.crs.to_wkt(version="WKT2_2019")) if source.crs else None


def _days(record: Mapping[str, Any]) -> tuple[date, ...]:
    """Days of the surveys: those that the record names, else those in the roles of its inputs."""
    named = [one.get("date") for one in record.get("epochs") or () if isinstance(one, dict)]
    named = named or list(record.get("dates") or ())
    named = named or [str(i["role"]).removeprefix("epoch ") for i in record.get("inputs", ()) if "epoch " in i["role"]]
    return tuple(sorted(day for one in named if (day := _day(one)) is not None))


def _day(value: Any) -> date | None:
    try:
        return date.fromisoformat(str(value))
    except ValueError:
        return None
