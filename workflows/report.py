"""``report``: the report of a run made again, with other profiles if wanted."""

from __future__ import annotations

import dataclasses
import json
from datetime import date
from os.path import isdir, isfile
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS

from ..engine.core.errors import InputError
from ..engine.core.input_files import read_input, refuse_unusable
from ..engine.core.json_shapes import parse_json
from ..engine.core.json_values import plain
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.core.run_record import RunRecord
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import Stage, refuse_inputs_as_outputs, staged_outputs
from ..engine.grid.geotiff import read_raster
from ..engine.report.compose import check_report, compose, read_record, write_report
from ..engine.report.signed.details import details_of
from ..engine.report.signed.source import surveys_of
from ..engine.report.signed.typesetting import refuse_without_means
from ..engine.report.signed.write import write_pdf
from ..engine.vector.geopackage import read_layer
from ..engine.zones.profile_lines import given_lines
from ..engine.zones.profiles import PROFILE_OUTPUTS, Layers, missed_lines
from ..interface.input_files import RECORD
from ..interface.parameters import DetailParameters, ReportParameters
from .photos import enter_photos
from .products.change import profile_products
from .products.m3c2 import ZONES
from .run import pdf_name_of, report_name_of

_PROFILES = ("profiles.csv", "profiles.gpkg")
_RASTERS = ("elevation_change", "level_of_detection", "significant_change")


def report_step(
    folder: Path,
    parameters: ReportParameters,
    *,
    details: DetailParameters | None = None,
    profiles: Path | None,
    photos: Path | None = None,
    progress: Progress,
) -> RunResult:
    """Make the report of a run again from its record and its rasters.

    Args:
        folder: of the run, or its record; a folder without run.json is that of the only M3C2 record in it.
        details: of a report to sign; what is given in them replaces those in the run record, which keeps the others.
        profiles: vector file with lines. With it the folder's profiles are replaced by those along its lines and down
            the zones, and the run record lists them.
        photos: folder of pictures named after zones, which are entered in their tables first.

    Raises:
        InputError: the folder holds no run that has a report, the lines cannot be used, or the details do not fit.
    """
    folder, name = _place_of(Path(folder).absolute())
    refuse_unusable([("profiles", profiles)])
    record = read_record(folder, name)
    results, page_name, pdf_name = _results_of(record, folder), report_name_of(name), pdf_name_of(name)
    changed = _take_details(record, details)
    if profiles is not None and not record.get("epochs"):
        raise InputError(
            f"{folder} holds no change between two surveys to take profiles of; give the folder of inspect or change."
        )
    entered = {} if photos is None else {"photos": enter_photos(results, photos, progress)}
    if profiles is None and not changed:
        progress.update(0.0, "drawing the report")
        with staged_outputs(folder, last=page_name) as stage:
            write_report(folder, progress, stage.path(page_name), record=name, pictures=results)
        return RunResult({"report": folder / page_name}, entered, tuple(progress.warnings))
    written = [folder / each for each in (page_name, pdf_name, *PROFILE_OUTPUTS, name)]
    refuse_inputs_as_outputs(written, [profiles] if profiles else [])
    with staged_outputs(folder) as stage:
        outputs = {"report": stage.final(page_name)}
        if profiles is not None:
            outputs |= _take_profiles(record, stage, parameters, profiles, progress)
        if changed:
            outputs["report_pdf"] = stage.final(pdf_name)
        record["outputs"] |= {key: path.name for key, path in outputs.items()}
        text = json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False)
        stage.path(name).write_text(text + "\n", encoding="utf-8", errors="backslashreplace")
        progress.update(0.3, "drawing the report")
        table, lines = ((stage.folder if profiles else results) / each for each in _PROFILES)
        page = compose(read_record(stage.folder, name), results, table, progress=progress)
        stage.path(page_name).write_text(page, encoding="utf-8", errors="backslashreplace", newline="\n")
        check_report(stage.path(page_name))
        if changed:
            progress.update(0.7, "drawing the report")
            write_pdf(results, record, page, target=stage.path(pdf_name), lines=lines, progress=progress)
        progress.update(1.0, "drawing the report")
    figures = {"profiles": len(record["profiles"])} if profiles is not None else {}
    return RunResult(outputs | {"run": folder / name}, figures | entered, tuple(progress.warnings))


def _place_of(path: Path) -> tuple[Path, str]:
    """Folder and name of a run record, from either.

    Raises:
        InputError: the folder holds several of M3C2.
    """
    if isfile(path):  # pathlib raises on a name that is too long
        return path.parent, path.name
    if isfile(path / "run.json") or not isdir(path):
        return path, "run.json"
    found = [name.name for name in sorted(path.glob("*_run.json")) if _is_of_m3c2(name)]
    if len(found) > 1:
        raise InputError(f"{shown(path)} holds several runs of M3C2; give one of their records: {', '.join(found)}.")
    return path, found[0] if found else "run.json"


def _is_of_m3c2(record: Path) -> bool:
    try:
        found = parse_json(read_input(record, RECORD))
    except (InputError, ValueError):  # other files of that name are none of our business
        return False
    return isinstance(found, dict) and found.get("command") == "m3c2"


def _results_of(record: dict[str, Any], folder: Path) -> Path:
    """Folder of what the report shows: that of the record, but M3C2 may have written its zones elsewhere."""
    zones = Path(record["outputs"].get("m3c2_zones", ""))
    return (folder / zones).parent if zones.name == ZONES else folder


def _take_details(record: dict[str, Any], details: DetailParameters | None) -> bool:
    """Put what is given of details into the record; whether the record then wants a report to sign.

    Raises:
        InputError: they do not fit the surveys, or what makes a PDF is missing.
    """
    known = dict(record["parameters"].get(DetailParameters.record_name) or {})
    given = dataclasses.asdict(details or DetailParameters())
    known |= {name: value for name, value in given.items() if value or name not in known}
    if any(given.values()) and not known["pdf"]:
        raise InputError("Details of a report to sign were given, but no PDF is wanted; give --pdf as well.")
    if not known["pdf"]:
        return False
    record["parameters"][DetailParameters.record_name] = known
    refuse_without_means()
    details_of(record, surveys_of(record))
    return True


def _take_profiles(
    record: dict[str, Any], stage: Stage, parameters: ReportParameters, profiles: Path, progress: Progress
) -> dict[str, Path]:
    """Take profiles along other lines, and put them into the record; their files."""
    folder = stage.directory
    layers, crs = _layers(folder)
    lines = given_lines(profiles, crs, parameters.profile_field, progress)
    progress.update(0.1, "taking profiles")
    zones = read_layer(folder / "zones.gpkg", "zones")
    stamp = record["epochs"][1]["date"]
    day = date.fromisoformat(stamp) if stamp else None
    files, facts = profile_products(layers, zones, lines, parameters.zone_profiles, crs, day, stage)
    for sentence in missed_lines(facts):
        progress.warning(sentence)
    _record_profiles(record, facts, parameters, profiles, progress)
    return files


def _record_profiles(
    record: dict[str, Any],
    facts: list[dict[str, Any]],
    parameters: ReportParameters,
    profiles: Path,
    progress: Progress,
) -> None:
    """Put the new profiles, their file and the warnings about them into the run record."""
    made = RunRecord("report", {"report": parameters})
    made.add_input("profiles", profiles)
    record["profiles"] = plain(facts)
    record["inputs"] = [i for i in record["inputs"] if i["role"] != "profiles"] + made.inputs
    record["parameters"][parameters.record_name] = dataclasses.asdict(parameters)
    # warnings about the earlier lines no longer hold
    kept = [w for w in record["warnings"] if not w.startswith(("The profiles' lines ", "The profile "))]
    record["warnings"] = [*kept, *(w for w in progress.warnings if w not in kept)]


def _layers(folder: Path) -> tuple[Layers, CRS]:
    rasters = [read_raster(folder / f"{name}.tif") for name in _RASTERS]
    heights = [read_raster(folder / "surface_heights.tif", band) for band in (1, 2)]
    crs = rasters[0].crs
    if crs is None:
        raise InputError(f"{folder / _RASTERS[0]}.tif declares no reference system; make the change again.")
    layers = Layers(
        grid=rasters[0].grid,
        height_from=heights[0].array,
        height_to=heights[1].array,
        dz=rasters[0].array,
        level=rasters[1].array,
        significant=np.isfinite(rasters[2].array),
    )
    return layers, crs
