"""``report``: the report of an output folder made again, with other profiles if wanted."""

from __future__ import annotations

import dataclasses
import json
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS

from ..engine.core.errors import InputError
from ..engine.core.input_files import refuse_unusable
from ..engine.core.json_values import plain
from ..engine.core.progress import Progress
from ..engine.core.run_record import RunRecord
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import Stage, refuse_inputs_as_outputs, staged_outputs
from ..engine.grid.geotiff import read_raster
from ..engine.report.compose import REPORT, check_report, compose, read_record, write_report
from ..engine.report.signed.details import details_of
from ..engine.report.signed.source import surveys_of
from ..engine.report.signed.typesetting import refuse_without_means
from ..engine.report.signed.write import PDF, write_pdf
from ..engine.vector.geopackage import read_layer
from ..engine.zones.profile_lines import given_lines
from ..engine.zones.profiles import PROFILE_OUTPUTS, Layers, missed_lines
from ..interface.parameters import DetailParameters, ReportParameters
from .photos import enter_photos
from .products.change import profile_products

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
    """Make the report of ``folder`` again from its run record and its rasters.

    Args:
        details: of a report to sign; what is given in them replaces those in the run record, which keeps the others.
        profiles: vector file with lines. With it the folder's profiles are replaced by those along its lines and down
            the zones, and the run record lists them.
        photos: folder of pictures named after zones, which are entered in their tables first.

    Raises:
        InputError: the folder holds no run that has a report, the lines cannot be used, or the details do not fit.
    """
    folder = Path(folder).absolute()
    refuse_unusable([("profiles", profiles)])
    record = read_record(folder)
    changed = _take_details(record, details)
    if profiles is not None and not record.get("epochs"):
        raise InputError(
            f"{folder} holds no change between two surveys to take profiles of; give the folder of inspect or change."
        )
    entered = {} if photos is None else {"photos": enter_photos(folder, photos, progress)}
    if profiles is None and not changed:
        progress.update(0.0, "drawing the report")
        with staged_outputs(folder, last=REPORT) as stage:
            write_report(folder, progress, stage.path(REPORT))
        return RunResult({"report": folder / REPORT}, entered, tuple(progress.warnings))
    written = [folder / name for name in (REPORT, PDF, *PROFILE_OUTPUTS, "run.json")]
    refuse_inputs_as_outputs(written, [profiles] if profiles else [])
    with staged_outputs(folder) as stage:
        outputs = {"report": stage.final(REPORT)}
        if profiles is not None:
            outputs |= _take_profiles(record, stage, parameters, profiles, progress)
        if changed:
            outputs["report_pdf"] = stage.final(PDF)
        record["outputs"] |= {name: path.name for name, path in outputs.items()}
        text = json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False)
        stage.path("run.json").write_text(text + "\n", encoding="utf-8", errors="backslashreplace")
        progress.update(0.3, "drawing the report")
        table, lines = ((stage.folder if profiles else folder) / name for name in _PROFILES)
        page = compose(read_record(stage.folder), folder, table, progress=progress)
        stage.path(REPORT).write_text(page, encoding="utf-8", errors="backslashreplace", newline="\n")
        check_report(stage.path(REPORT))
        if changed:
            progress.update(0.7, "drawing the report")
            write_pdf(folder, record, page, target=stage.path(PDF), lines=lines, progress=progress)
        progress.update(1.0, "drawing the report")
    figures = {"profiles": len(record["profiles"])} if profiles is not None else {}
    return RunResult(outputs | {"run": folder / "run.json"}, figures | entered, tuple(progress.warnings))


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
