"""The formats of a hand-over: what each of them writes of one run's results."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import date
from pathlib import Path

import rasterio
import rasterio.shutil
from rasterio.errors import RasterioError

from ..engine.core.errors import EngineError, InputError
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.core.staged_outputs import atomic_output
from ..engine.handover import about as about_module
from ..engine.handover import drawing, landxml, metadata, naming, stac, styles, tables
from ..engine.handover.held import Held
from ..engine.handover.surfaces import Mesh, mesh
from ..engine.pointcloud.copc_writing import write_copc
from ..interface.parameters import HandoverParameters

_CLOUD_OPTIMISED = {"COMPRESS": "DEFLATE", "BLOCKSIZE": "512", "BIGTIFF": "IF_SAFER", "OVERVIEW_RESAMPLING": "AVERAGE"}
_MOST_MOSAIC_CELLS = 100_000_000
"""Of a mosaic that is written as one raster; slopes far from one another have nothing but nodata between them."""
_LINK = re.compile(r'<a href="(?P<to>[^"]*)">(?P<word>.*?)</a>', re.DOTALL)
_NAMES = {
    "cog": "Cloud Optimized GeoTIFF", "gpkg": "GeoPackage", "geojson": "GeoJSON", "kml": "KML", "csv": "CSV",
    "dxf": "DXF", "landxml": "LandXML", "styles": "QML and SLD", "stac": "STAC", "report": "HTML", "copc": "COPC",
}  # fmt: skip
"""Of the formats, in the metadata."""


@dataclass(frozen=True)
class Part:
    """One run's results that are handed over, where to, how: the writers take it and name their files from ``folder``.

    ``reports`` are the pages that its own page links to, and where they lie in the hand-over (empty: nowhere);
    ``collection`` is the STAC collection of the part's item, from its folder, and that collection's id.
    """

    held: Held
    about: about_module.About
    meshes: Mapping[str, Mesh]
    names: Mapping[str, str]
    folder: Path
    progress: Progress
    reports: Mapping[str, str] = field(default_factory=dict)
    collection: tuple[str, str] | None = None

    @property
    def stamp(self) -> date | None:
        return self.held.days[-1] if self.held.days else None

    def path(self, name: str) -> Path:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


def prepared(
    held: Held,
    parameters: HandoverParameters,
    names: Mapping[str, str],
    chosen: tuple[str, ...],
    folder: Path,
    progress: Progress,
    *,
    title: str = "",
) -> Part:
    """What is needed to write ``held`` into ``folder``.

    Args:
        names: agreed names of fields, as ``field_mapping`` reads them.
        title: what the metadata call it, where it is not the folder of its run.

    Raises:
        InputError: a cloud is gone, two fields would have one name, or the results have no place.
    """
    if "copc" in chosen:
        lost = next((path for path in held.clouds.values() if not path.is_file()), None)
        if lost is not None:
            raise InputError(f"{shown(lost)} is missing, though the run wrote it; put it back, or leave copc out.")
    held = replace(held, layers=naming.renamed_layers(held.layers, names))
    about = about_module.describe(
        held, parameters.metadata_title, parameters.organisation, parameters.email, parameters.licence, name=title
    )
    drawn = {"dxf", "landxml"} & set(chosen)
    meshes = (
        {name: mesh(surface, parameters.surface_points) for name, surface in held.surfaces.items()} if drawn else {}
    )
    return Part(held, about, meshes, names, folder, progress)


def write_part(part: Part, chosen: tuple[str, ...]) -> list[str]:
    """Write the chosen formats; the names of the files from the part's folder."""
    files: list[str] = []
    steps = [word for word in chosen if word in _WRITERS]
    for number, word in enumerate(steps):
        part.progress.update(number / (len(steps) + 1), f"writing {_NAMES[word]}")
        files += _WRITERS[word](part)
    if "iso" in chosen:
        metadata.write_metadata(
            part.path("metadata/iso19139.xml"), part.about, [_NAMES[w] for w in chosen if w in _NAMES]
        )
        files.append("metadata/iso19139.xml")
    if "stac" in chosen:
        stac.write_item(part.path("item.json"), part.about, part.folder, files, part.collection)
        files.append("item.json")
    return files


def _rasters(part: Part) -> list[str]:
    files = []
    for name, source in part.held.rasters.items():
        if source.suffix == ".vrt" and (cells := _cells(source)) > _MOST_MOSAIC_CELLS:
            part.progress.warning(
                f"The mosaic {shown(source.name)} is not handed over: its slopes lie so far apart that it has "
                f"{cells / 1e6:.0f} million cells, which are empty for the most part. Take the rasters of the slopes."
            )
            continue
        files.append(f"rasters/{name}.tif")
        _copy_raster(source, part.path(files[-1]))
    return files


def _cells(path: Path) -> int:
    with rasterio.open(path) as source:
        return int(source.width) * int(source.height)


def _copy_raster(source: Path, target: Path) -> None:
    """The raster's own bytes where they are cloud-optimised, else written so, with all bands and tags."""
    try:
        with rasterio.open(source) as opened:
            is_optimised = opened.tags(ns="IMAGE_STRUCTURE").get("LAYOUT") == "COG"
            predictor = "3" if opened.dtypes[0].startswith("float") else "2"
            if not is_optimised:
                with rasterio.Env(GDAL_PAM_ENABLED="NO", GDAL_NUM_THREADS="1"), atomic_output(target) as partial:
                    rasterio.shutil.copy(opened, partial, driver="COG", PREDICTOR=predictor, **_CLOUD_OPTIMISED)
    except RasterioError as error:
        raise InputError(f"{shown(source)} cannot be read as a raster; make the run again.") from error
    if is_optimised:
        shutil.copyfile(source, target)
    with rasterio.open(target) as written:
        if written.tags(ns="IMAGE_STRUCTURE").get("LAYOUT") != "COG":
            raise EngineError(f"{target.name} read back is not cloud-optimised")


def _package(part: Part) -> list[str]:
    if not part.held.layers:
        return []
    tables.write_package(part.path("layers.gpkg"), part.held.layers, stamp=part.stamp)
    return ["layers.gpkg"]


def _each_layer(part: Part, folder: str, ending: str, write: Callable[..., None]) -> list[str]:
    files = []
    for layer in part.held.layers:
        if layer.places is not None or ending == "csv":
            files.append(f"{folder}/{layer.name}.{ending}")
            write(part.path(files[-1]), layer)
    return files


def _geojson(part: Part) -> list[str]:
    return _each_layer(part, "geojson", "geojson", tables.write_geojson)


def _kml(part: Part) -> list[str]:
    """Each layer on the ground, and, where the ground is known, the zones at its heights."""
    files = _each_layer(part, "kml", "kml", tables.write_kml)
    surfaces = list(part.held.surfaces.values())
    for layer in part.held.zones if surfaces else ():
        files.append(f"kml/{layer.name}_heights.kml")
        tables.write_kml(part.path(files[-1]), layer, surfaces[-1])
    return files


def _csv(part: Part) -> list[str]:
    files = _each_layer(part, "csv", "csv", tables.write_csv)
    plain = {layer.name for layer in part.held.layers if layer.places is None}
    for name, source in part.held.tables.items():
        if name in plain:  # the layer is the same table
            continue
        # a layer with places may have the name of a table that is another one
        taken = f"csv/{name}.csv" in files
        files.append(f"csv/{name}_table.csv" if taken else f"csv/{name}.csv")
        tables.copy_table(source, part.path(files[-1]))
    return files


def _dxf(part: Part) -> list[str]:
    drawing.write_dxf(part.path("cad/drawing.dxf"), part.held, part.meshes, part.names)
    return ["cad/drawing.dxf"]


def _landxml(part: Part) -> list[str]:
    landxml.write_landxml(part.path("cad/landxml.xml"), part.held, part.meshes, part.about.title)
    return ["cad/landxml.xml"]


def _styles(part: Part) -> list[str]:
    found = {f"rasters/{name}": path.with_suffix(".qml") for name, path in part.held.rasters.items()}
    qml = {name: path.read_text(encoding="utf-8") for name, path in found.items() if path.is_file()}
    qml |= {f"styles/{layer.name}": layer.qml for layer in part.held.layers if layer.qml}
    files = []
    for name, text in qml.items():
        for ending, content in (("qml", text), ("sld", styles.sld_of(text, Path(name).name))):
            if content:
                files.append(f"{name}.{ending}")
                part.path(files[-1]).write_text(content, encoding="utf-8", newline="\n")
    return files


def _report(part: Part) -> list[str]:
    files = []
    for path in part.held.pages.values():
        files.append(f"report/{path.name}")
        if part.reports and path.suffix == ".html":
            page = _linked(path.read_text(encoding="utf-8"), part.reports)
            part.path(files[-1]).write_text(page, encoding="utf-8", newline="\n")
        else:
            shutil.copyfile(path, part.path(files[-1]))
    return files


def _linked(page: str, reports: Mapping[str, str]) -> str:
    """A page whose links lead to where the reports lie in the hand-over; what does not lie there is no link."""

    def led(found: re.Match[str]) -> str:
        if found["to"] not in reports:
            return found[0]
        there = reports[found["to"]]
        return f'<a href="../{there}">{found["word"]}</a>' if there else found["word"]

    return _LINK.sub(led, page)


def _copc(part: Part) -> list[str]:
    files = []
    for name, source in part.held.clouds.items():
        files.append(f"clouds/{name}.copc.laz")
        write_copc(source, part.path(files[-1]))
    return files


_WRITERS: Mapping[str, Callable[[Part], list[str]]] = {
    "cog": _rasters, "gpkg": _package, "geojson": _geojson, "kml": _kml, "csv": _csv, "dxf": _dxf, "landxml": _landxml,
    "styles": _styles, "report": _report, "copc": _copc,
}  # fmt: skip
