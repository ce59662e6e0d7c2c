"""The report of a folder made again: of a slope, or of a corridor from the folder that a batch wrote."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from os.path import isfile
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd

from ..engine.core.errors import InputError
from ..engine.core.input_files import read_input
from ..engine.core.json_shapes import anything, fields, number, parse_json, rows, table, text
from ..engine.core.messages import shown as in_message
from ..engine.core.part_folders import settle
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import staged_outputs
from ..engine.report.record_shape import inside
from ..engine.report.signed.details import FLIGHT, details_of
from ..engine.report.signed.typesetting import refuse_without_means
from ..engine.vector.geopackage import read_layer
from ..interface.input_files import RECORD
from ..interface.parameters import DetailParameters, ReportParameters
from .batch.alert_events import open_of
from .batch.corridor_plan import read_record
from .batch.pages import Shown, page_of, write_pdf_of
from .batch.product_names import GEOPACKAGE, PAGE, PAGE_PDF
from .batch.products import read_alerts
from .batch.ranking import rank
from .batch.results import SlopeResult
from .report import report_step

_COMMAND = "batch"
_RECORD = fields(
    {
        "command": text(), "started": text(), "parameters": table(table(anything)), "outputs": table(text()),
        "metrics": fields({}, {"slopes": number(0.0)}), "inputs": rows(fields({"role": text()}, {"path": text()})),
    },
    {
        "failed": rows(fields({"slope": text(), "sentence": text()})), "settings": table(anything),
        "manifest": text(),
    },
)  # fmt: skip
_SLOPE = fields({"command": text(), "inputs": rows(fields({"role": text()})), "outputs": fields({})})


def report_of_folder(
    folder: Path,
    parameters: ReportParameters,
    *,
    details: DetailParameters | None = None,
    profiles: Path | None = None,
    photos: Path | None = None,
    progress: Progress,
) -> RunResult:
    """The report of a folder again, be it of a slope (see ``report.report_step``) or of a corridor.

    Raises:
        InputError: as these do; or profiles or photos were given with a corridor.
    """
    folder = Path(folder).absolute()
    record = None if isfile(folder) else corridor_record(folder)
    if record is None:
        return report_step(folder, parameters, details=details, profiles=profiles, photos=photos, progress=progress)
    if profiles is not None or photos is not None:
        raise InputError(
            f"{folder} holds a corridor; profiles and photos belong to a slope, so give the folder of one."
        )
    return corridor_report(folder, record, details, progress)


def corridor_record(folder: Path) -> dict[str, Any] | None:
    """The run record of a folder that a batch wrote; None where it is of something else, or there is none.

    Raises:
        InputError: it is of a batch, and damaged.
    """
    record = read_record(folder)
    if record is None or record.get("command") != _COMMAND:
        return None
    try:
        # times of change stand in it in nanoseconds, which no other file of ours has
        _RECORD({name: value for name, value in record.items() if name != "tables_stamp"}, "")
    except ValueError as error:
        raise InputError(
            f"{in_message(folder / 'run.json')} is no run record that can be read ({error}); run the batch again."
        ) from error
    return record


def corridor_report(
    folder: Path, record: dict[str, Any], details: DetailParameters | None, progress: Progress
) -> RunResult:
    """Make both again as the tables of the folder are now, with what people entered in them.

    Args:
        record: the run record of the folder.
        details: of the report to sign; what is given in them replaces what the folder keeps.

    Raises:
        InputError: a table cannot be read, or the details do not fit.
    """
    known = _details(record, details)
    if known["pdf"]:
        refuse_without_means()
        details_of({"parameters": {"details": {**known, **dict.fromkeys(FLIGHT, "")}}}, ("",))
    progress.update(0.0, "reading the corridor")
    shown = read_corridor(folder, record)
    with staged_outputs(folder) as stage:
        outputs = {"page": stage.final(PAGE)}
        stage.path(PAGE).write_text(page_of(shown), encoding="utf-8", errors="backslashreplace", newline="\n")
        if known["pdf"]:
            with progress.stage(0.1, 1.0, "drawing the report"):
                write_pdf_of(shown, stage.path(PAGE_PDF), known, str(record["started"]), progress)
            outputs["page_pdf"] = stage.final(PAGE_PDF)
            record["parameters"][DetailParameters.record_name] = known
        record["outputs"] |= {name: path.name for name, path in outputs.items()}
        whole = json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False)
        stage.path("run.json").write_text(whole + "\n", encoding="utf-8", errors="backslashreplace")
    progress.update(1.0, "drawing the report")
    return RunResult(outputs | {"run": folder / "run.json"}, {}, tuple(progress.warnings))


def read_corridor(folder: Path, record: Mapping[str, Any]) -> Shown:
    """What the pages of a batch's folder show.

    Raises:
        InputError: corridor.gpkg is not there or cannot be read.
    """
    path = folder / GEOPACKAGE
    alerts = read_alerts(folder)
    if alerts is None:
        raise InputError(f"{path} is not there, or has no layer of alerts; run the batch again.")
    zones, slopes = (read_layer(path, name) for name in ("zones", "slopes"))
    wanted = {"slope", "surveys", "last_survey", "report", "state"}
    if not wanted <= set(slopes.columns):
        raise InputError(f"The layer slopes of {path} lacks some of {', '.join(sorted(wanted))}; run the batch again.")
    done = slopes[slopes["state"] == "done"]
    results = [_result(folder, row) for row in done.to_dict("records")]
    failed = record.get("failed") or []
    manifest = record.get("manifest")
    return Shown(
        ranked=rank(results, _in_kinds(zones), alerts, folder),
        failed=[(str(one["slope"]), str(one["sentence"])) for one in failed],
        zones=zones,
        alerts=open_of(alerts),
        slopes=slopes,
        folders={result.slope: result.folder for result in results},
        manifest=str(manifest) if manifest else _manifest_of(record),
        count=int(record["metrics"].get("slopes") or len(slopes)),
    )


def _details(record: Mapping[str, Any], details: DetailParameters | None) -> dict[str, Any]:
    """What the batch was given, what the folder keeps since, and what is given now.

    Raises:
        InputError: details without a wish for a PDF.
    """
    known = asdict(DetailParameters())
    for kept in (record.get("settings"), record["parameters"].get(DetailParameters.record_name)):
        if isinstance(kept, dict):
            known |= {name: kept[name] for name in known if isinstance(kept.get(name), type(known[name]))}
    given = {name: value for name, value in asdict(details or DetailParameters()).items() if value}
    known |= given
    if given and not known["pdf"]:
        raise InputError("Details of a report to sign were given, but no PDF is wanted; give --pdf as well.")
    return known


def _manifest_of(record: Mapping[str, Any]) -> str:
    """Of a batch whose record does not name it: that of its inputs."""
    return next((Path(str(i.get("path", ""))).name for i in record["inputs"] if i["role"] == "manifest"), "")


def _result(folder: Path, row: Mapping[str, Any]) -> SlopeResult:
    """The results of a slope by its row; only its surveys where its folder is gone or holds something else."""
    days = [{"role": f"epoch {row['last_survey']}"}] * max(1, int(row["surveys"]))
    alone = SlopeResult(str(row["slope"]), folder / "slopes" / "-", {"command": "", "inputs": days}, {})
    report = inside(folder, str(row["report"] or ""))
    if report is None:
        return alone
    settle(report.parent)
    if not report.is_file():
        return alone
    try:
        record = parse_json(read_input(report.parent / "run.json", RECORD))
        _SLOPE(record, "")
    except (InputError, ValueError):
        return alone
    outputs = {str(name): report.parent / str(path) for name, path in record["outputs"].items()}
    return SlopeResult(str(row["slope"]), report.parent, record, outputs)


def _in_kinds(zones: gpd.GeoDataFrame) -> gpd.GeoDataFrame:
    """The zones as they were before they were written: a table without rows is read back with columns of no kind."""
    numbers = ("attention", "rate_mm_day", "vol_net_m3", "dz_p95_m", "chain_from", "motion_m")
    kinds = {name: pd.to_numeric(zones[name], errors="coerce").astype(np.float64) for name in numbers if name in zones}
    return zones.assign(**kinds)
