"""``slopewatch exportgis``: the results of a finished run as files of other systems, with checksums."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import rasterio
import rasterio.shutil
from rasterio.errors import RasterioError

from ..engine.core.errors import EngineError, InputError
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import Stage, atomic_output, refuse_unwritable
from ..engine.handover import about as about_module
from ..engine.handover import drawing, landxml, metadata, naming, package, stac, styles, tables
from ..engine.handover.held import Held, find_record, read_held
from ..engine.handover.postgis.address import Database, parse_address
from ..engine.handover.postgis.schema import check_name
from ..engine.handover.postgis.writing import Counts
from ..engine.handover.surfaces import Mesh, mesh
from ..engine.pointcloud.copc_writing import write_copc
from ..engine.vector.field_mapping import read_field_mapping
from ..interface.parameters import HANDOVER_FORMATS, HandoverParameters, OutputParameters
from .postgis import for_database
from .run import Run, record_name_of

HANDOVER_OUTPUTS = ("item.json", package.CHECKSUMS, "run.json")
_CLOUD_OPTIMISED = {"COMPRESS": "DEFLATE", "BLOCKSIZE": "512", "BIGTIFF": "IF_SAFER", "OVERVIEW_RESAMPLING": "AVERAGE"}
_NAMES = {
    "cog": "Cloud Optimized GeoTIFF", "gpkg": "GeoPackage", "geojson": "GeoJSON", "kml": "KML", "csv": "CSV",
    "dxf": "DXF", "landxml": "LandXML", "styles": "QML and SLD", "stac": "STAC", "report": "HTML", "copc": "COPC",
}  # fmt: skip
"""Of the formats, in the metadata."""


@dataclass(frozen=True)
class _Job:
    """What is handed over, where to, how: the writers take it and name their files from ``folder``."""

    held: Held
    about: about_module.About
    meshes: Mapping[str, Mesh]
    names: Mapping[str, str]
    folder: Path
    progress: Progress

    @property
    def stamp(self) -> date | None:
        return self.held.days[-1] if self.held.days else None

    def path(self, name: str) -> Path:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


def export_step(
    run_folder: Path,
    output: Path | None,
    parameters: HandoverParameters,
    *,
    address: str = "",
    fields: Path | None = None,
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """Write what the folder of a finished run holds in the chosen formats, with a file of checksums, or to a database.

    Args:
        run_folder: the folder, or the run record in it.
        output: a ZIP archive where the name ends in ``.zip``, else a folder; None: the database only.
        address: of a database for zones, events and their history; empty: none. It is in no record.
        fields: mapping file of field names, see ``read_field_mapping``.

    Raises:
        InputError: the run is not finished, or something given cannot be used; nothing is written then.
    """
    database = parse_address(address) if address else None
    if database is not None:
        check_name(parameters.schema)
    if output is None:
        if database is None:
            raise InputError("Neither --output nor --to was given; say where the results are to go.")
        return _to_database(run_folder, database, parameters, fields, progress)
    chosen = _formats(parameters.formats)
    record = find_record(run_folder)
    groups = {"handover": parameters, "outputs": OutputParameters(overwrite=overwrite)}
    run = Run("exportgis", groups, [("run", record), ("fields", fields)], progress)
    zipped = output.suffix.lower() == ".zip"
    folder = output.absolute().parent if zipped else output.absolute()
    names = (output.name, record_name_of(output)) if zipped else HANDOVER_OUTPUTS
    if zipped:
        refuse_unwritable(output)
    elif folder == record.parent.absolute():
        raise InputError(f"The output {shown(output)} is the folder of the run itself; give another one.")
    run.refuse_folder(folder, names, overwrite=overwrite)
    run.hash_inputs()
    with run.step("read", 0.0, 0.1, "reading the results"):
        held = read_held(run_folder)
        rows = None if database is None else for_database(database, held, fields, progress)
        job = _job(held, parameters, read_field_mapping(fields).flat, chosen, progress)
    with (
        run.writing(folder, record_name=names[-1]) as stage,
        tempfile.TemporaryDirectory(dir=stage.folder) as temporary,
    ):
        place = Path(temporary) if zipped else stage.folder
        job = replace(job, folder=place)
        with run.step("write", 0.1, 0.95, "writing"):
            files = _write(job, chosen)
        with run.step("package", 0.95, 1.0, "packing"):
            files.append(package.write_checksums(place, files))
            run.outputs |= _pack(stage, place, files, output.name if zipped else "")
        size = sum((place / name).stat().st_size for name in files)
        run.figures = {
            "files": len(files),
            "bytes": size,
            "layers": len(job.held.layers),
            "rasters": len(job.held.rasters),
        }
        run.facts["not_held"] = job.held.missing()
        if rows is not None:  # last, so that no file is missing of what a database has
            run.figures |= _counts(rows.write(parameters, progress))
            run.facts["database"] = {"address": rows.database.shown, "schema": parameters.schema}
    return run.result()


def _pack(stage: Stage, place: Path, files: list[str], archive: str) -> dict[str, Path]:
    """The files into ``archive``, or as they are where that is empty; the outputs by name."""
    if archive:
        package.write_zip(stage.path(archive), place, files)
        return {"handover": stage.final(archive)}
    for name in package.named_in(stage.directory).difference(files):  # of the hand-over that this one replaces
        stage.discard(name)
    return {name: stage.final(name) for name in files}


def _to_database(
    run_folder: Path, database: Database, parameters: HandoverParameters, fields: Path | None, progress: Progress
) -> RunResult:
    """Only that; no file is written."""
    with progress.stage(0.0, 0.3, "reading the results"):
        rows = for_database(database, read_held(run_folder), fields, progress)
    with progress.stage(0.3, 1.0, "handing over"):
        figures = _counts(rows.write(parameters, progress))
    said = (
        f"{figures['database_zones']} zones and {figures['database_events']} events were handed over to "
        f"{database.shown}, schema {parameters.schema}; {figures['database_history']} entries are new in the history."
    )
    return RunResult({}, figures, tuple(progress.warnings), (said,))


def _counts(counts: Counts) -> dict[str, int]:
    return {f"database_{name}": getattr(counts, name) for name in ("zones", "events", "history", "newer")}


def _formats(text: str) -> tuple[str, ...]:
    """The chosen formats in the order in which they are written.

    Raises:
        InputError: one is not known, or none is given.
    """
    given = [word for part in text.split(",") if (word := part.strip().lower())]
    odd = next((word for word in given if word not in HANDOVER_FORMATS), None)
    known = ", ".join(HANDOVER_FORMATS)
    if odd is not None:
        raise InputError(f"formats has {shown(odd)}, which is none; give some of {known}.")
    if not given:
        raise InputError(f"formats is empty; give some of {known}.")
    return tuple(word for word in HANDOVER_FORMATS if word in given)


def _job(
    held: Held,
    parameters: HandoverParameters,
    names: Mapping[str, str],
    chosen: tuple[str, ...],
    progress: Progress,
) -> _Job:
    if "copc" in chosen:
        lost = next((path for path in held.clouds.values() if not path.is_file()), None)
        if lost is not None:
            raise InputError(f"{shown(lost)} is missing, though the run wrote it; put it back, or leave copc out.")
    unknown = naming.unknown_names(held.layers, names)
    if unknown:
        progress.warning(f"The mapping file names fields that this run does not have: {', '.join(unknown)}.")
    for word in held.missing():
        progress.info(f"The run holds no {word}, so none are handed over.")
    held = replace(held, layers=naming.renamed_layers(held.layers, names))
    about = about_module.describe(
        held, parameters.metadata_title, parameters.organisation, parameters.email, parameters.licence
    )
    drawn = {"dxf", "landxml"} & set(chosen)
    meshes = (
        {name: mesh(surface, parameters.surface_points) for name, surface in held.surfaces.items()} if drawn else {}
    )
    return _Job(held, about, meshes, names, Path(), progress)


def _write(job: _Job, chosen: tuple[str, ...]) -> list[str]:
    """Write the chosen formats; the names of the files from the job's folder."""
    files: list[str] = []
    steps = [word for word in chosen if word in _WRITERS]
    for number, word in enumerate(steps):
        job.progress.update(number / (len(steps) + 1), f"writing {_NAMES[word]}")
        files += _WRITERS[word](job)
    if "iso" in chosen:
        metadata.write_metadata(
            job.path("metadata/iso19139.xml"), job.about, [_NAMES[w] for w in chosen if w in _NAMES]
        )
        files.append("metadata/iso19139.xml")
    if "stac" in chosen:
        stac.write_item(job.path("item.json"), job.about, job.folder, files)
        files.append("item.json")
    if not files:
        raise InputError("Nothing of the chosen formats is in the results; choose other formats.")
    return files


def _rasters(job: _Job) -> list[str]:
    files = []
    for name, source in job.held.rasters.items():
        files.append(f"rasters/{name}.tif")
        _copy_raster(source, job.path(files[-1]))
    return files


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


def _package(job: _Job) -> list[str]:
    if not job.held.layers:
        return []
    tables.write_package(job.path("layers.gpkg"), job.held.layers, stamp=job.stamp)
    return ["layers.gpkg"]


def _each_layer(job: _Job, folder: str, ending: str, write: Callable[..., None]) -> list[str]:
    files = []
    for layer in job.held.layers:
        if layer.places is not None or ending == "csv":
            files.append(f"{folder}/{layer.name}.{ending}")
            write(job.path(files[-1]), layer)
    return files


def _geojson(job: _Job) -> list[str]:
    return _each_layer(job, "geojson", "geojson", tables.write_geojson)


def _kml(job: _Job) -> list[str]:
    """Each layer on the ground, and, where the ground is known, the zones at its heights."""
    files = _each_layer(job, "kml", "kml", tables.write_kml)
    surfaces = list(job.held.surfaces.values())
    for layer in job.held.zones if surfaces else ():
        files.append(f"kml/{layer.name}_heights.kml")
        tables.write_kml(job.path(files[-1]), layer, surfaces[-1])
    return files


def _csv(job: _Job) -> list[str]:
    files = _each_layer(job, "csv", "csv", tables.write_csv)
    plain = {layer.name for layer in job.held.layers if layer.places is None}
    for name, source in job.held.tables.items():
        if name in plain:  # the layer is the same table
            continue
        # a layer with places may have the name of a table that is another one
        taken = f"csv/{name}.csv" in files
        files.append(f"csv/{name}_table.csv" if taken else f"csv/{name}.csv")
        shutil.copyfile(source, job.path(files[-1]))
    return files


def _dxf(job: _Job) -> list[str]:
    drawing.write_dxf(job.path("cad/drawing.dxf"), job.held, job.meshes, job.names)
    return ["cad/drawing.dxf"]


def _landxml(job: _Job) -> list[str]:
    landxml.write_landxml(job.path("cad/landxml.xml"), job.held, job.meshes, job.about.title)
    return ["cad/landxml.xml"]


def _styles(job: _Job) -> list[str]:
    found = {f"rasters/{name}": path.with_suffix(".qml") for name, path in job.held.rasters.items()}
    qml = {name: path.read_text(encoding="utf-8") for name, path in found.items() if path.is_file()}
    qml |= {f"styles/{layer.name}": layer.qml for layer in job.held.layers if layer.qml}
    files = []
    for name, text in qml.items():
        for ending, content in (("qml", text), ("sld", styles.sld_of(text, Path(name).name))):
            if content:
                files.append(f"{name}.{ending}")
                job.path(files[-1]).write_text(content, encoding="utf-8", newline="\n")
    return files


def _report(job: _Job) -> list[str]:
    files = []
    for path in job.held.pages.values():
        files.append(f"report/{path.name}")
        shutil.copyfile(path, job.path(files[-1]))
    return files


def _copc(job: _Job) -> list[str]:
    files = []
    for name, source in job.held.clouds.items():
        files.append(f"clouds/{name}.copc.laz")
        write_copc(source, job.path(files[-1]))
    return files


_WRITERS: Mapping[str, Callable[[_Job], list[str]]] = {
    "cog": _rasters, "gpkg": _package, "geojson": _geojson, "kml": _kml, "csv": _csv, "dxf": _dxf, "landxml": _landxml,
    "styles": _styles, "report": _report, "copc": _copc,
}  # fmt: skip
