"""How a slope was surveyed and compared: flights, registration, volumes, files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import Any

from ....interface import corrections
from ....interface.seen import KEYS, NOT_SEEN
from ....interface.seen import LABELS as LABELS_OF_SEEN
from ..compose import role_words
from ..figures_in_text import figure, interval, percent, say, value_of, with_error
from . import blocks
from .blocks import Block, Cell, Column
from .details import FLIGHT, LABELS, Details

_GROUND = {
    "extract": "extracted from all points",
    "class_2": "points of class 2 of the surveys",
    "as_is": "all points of the surveys",
}
_DIGITS = {"m²": 1, "m³": 2, "m": 4, "%": 1}


def surveyed(record: Mapping[str, Any], details: Details) -> list[Block]:
    """Flights, registration, areas and volumes, and the files with their checksums."""
    made = [blocks.heading(say("Surveys and flights")), _flights(record, details)]
    if record.get("coverage") and record.get("dates"):
        made += [blocks.heading(say("What each survey saw"), 2), _seen(record)]
    facts = _measured(record)
    if facts:
        made += [blocks.heading(say("How the surveys were compared"), 2), blocks.facts(facts)]
    if record.get("volumes"):
        made += [blocks.heading(say("Areas and volumes"), 2), _volumes(record["volumes"]["rows"])]
    if record.get("corrections"):
        made += [blocks.heading(say("Corrections by hand"), 2), _corrections(record["corrections"]["areas"])]
    return [*made, blocks.heading(say("Files"), 2), _files(record)]


def _flights(record: Mapping[str, Any], details: Details) -> Block:
    """One row a survey; what was not given is left to fill in by hand."""
    density = record.get("density") or []
    columns = [Column(say("Survey"), left=True)]
    columns += [Column(say(LABELS[name]), left=True, wide=name == "weather") for name in FLIGHT]
    columns += [Column(say("Ground points per m²"))] if density else []
    rows: list[list[Cell]] = []
    for number, survey in enumerate(details.surveys):
        row: list[Cell] = [survey, *(details.of_flight(name, number) or "…………" for name in FLIGHT)]
        if density:
            row.append(figure(density[number], "median_points_m2", digits=0) if number < len(density) else "–")
        rows.append(row)
    return blocks.table(columns, rows)


def _seen(record: Mapping[str, Any]) -> Block:
    """Of each survey of a series: density, share compared, error, and the ground that was left out."""
    columns = [Column(say("Survey"), left=True), Column(say("Ground points per m²")), Column(say("Compared"))]
    columns += [Column(say("Error of a cell (m)")), Column(say("Only in the first survey (m²)"))]
    columns += [Column(say("Only in this survey (m²)")), Column(say("Too few points (m²)"))]
    columns.append(Column(say("Vegetation (m²)")))
    left_out = ("only_first_m2", "only_this_m2", "too_few_points_m2", "vegetation_m2")
    first = figure(record["coverage"][0], "first_points_m2", digits=0)
    rows: list[list[Cell]] = [[str(record["dates"][0]), first, *["–"] * 6]]
    rows += [
        [
            str(survey["epoch"]), figure(survey, "points_m2", digits=0), percent(survey, "compared_share"),
            figure(survey, "error_median_m"), *(figure(survey, name, digits=0) for name in left_out),
        ]
        for survey in record["coverage"]
    ]  # fmt: skip
    words = say(
        "All surveys are compared with the first one. The error is one standard error, the median of all cells. "
        "Vegetation: change that it may have made, which counts in no zone."
    )
    return blocks.table(columns, rows, words)


def _measured(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Registration and grid, as far as the record has them."""
    registration, metrics = record.get("registration") or {}, record["metrics"]
    rows: list[tuple[str, str]] = []
    ground = _GROUND.get(record["parameters"].get("ground", {}).get("ground"))
    if ground:
        rows.append((say("Ground"), say(ground)))
    if record.get("grid"):
        rows.append(_cells(record))
    if registration.get("registration_method"):
        shift = (figure(registration, f"registration_{axis}_m", digits=3, sign=True) for axis in ("dx", "dy", "dz"))
        rows += [
            (say("Registration"), say(str(registration["registration_method"]))),
            (say("Shift east, north, up (m)"), ", ".join(shift)),
            (say("Residual on stable ground"), figure(registration, "registration_residual_after_m", "m", 4)),
            (say("Registration error in height"), figure(registration, "registration_error_m", "m", 4)),
        ]
    if value_of(metrics, "compared_share") is not None:
        rows.append((say("Slope compared"), percent(metrics, "compared_share")))
    shares = record.get("seen") or {}
    rows += [(say(LABELS_OF_SEEN[one]), percent(shares, KEYS[one])) for one in NOT_SEEN if value_of(shares, KEYS[one])]
    for name, words in (("normal_scale_m", "Normal scale"), ("projection_scale_m", "Projection scale")):
        if value_of(metrics, name) is not None:
            rows.append((say(words), figure(metrics, name, "m", 2)))
    if value_of(metrics, "lod_median_m") is not None:
        rows.append((say("Level of detection, median"), figure(metrics, "lod_median_m", "m")))
    return rows


def _cells(record: Mapping[str, Any]) -> tuple[str, str]:
    """The side of a cell; where cells grew, each with its share of the area compared."""
    sizes = record.get("cell_sizes") or []
    if not sizes:
        return say("Side of a cell"), figure(record["grid"], "cell_m", "m", 2)
    parts = [f"{figure(row, 'side_m', 'm', 2)}: {percent(row, 'share', _share_digits(row))}" for row in sizes]
    return say("Sides of the cells (shares of the area compared)"), ", ".join(parts)


def _share_digits(row: Mapping[str, Any]) -> int:
    """Decimals of a percentage, of which a small one must not look like none."""
    return 0 if (value_of(row, "share") or 0.0) >= 0.01 else 1


def _volumes(rows: list[dict[str, Any]]) -> Block:
    columns = [
        Column(say("Attribute"), left=True, wide=True),
        Column(say("Raw")),
        Column(say("Thresholded")),
        Column(say("95 % interval")),
        Column(say("Error (%)")),
    ]
    table: list[list[Cell]] = []
    for row, before in zip(rows, [{}, *rows], strict=False):
        if row["group"] != before.get("group"):
            table.append([blocks.bold(say(str(row["group"]).capitalize())), "", "", "", ""])
        digits = _DIGITS.get(row["unit"], 2)
        table.append(
            [
                f"{say(row['quantity'])} ({say(row['unit'])})",
                with_error(row, "raw", "raw_error", digits=digits, sign=False),
                with_error(row, "thresholded", "standard_error", digits=digits, sign=False),
                interval(row, "low_95", "high_95", digits=digits, sign=False),
                figure(row, "error_percent", digits=1),
            ]
        )
    return blocks.table(columns, table, size=7.0)


def _corrections(rows: list[dict[str, Any]]) -> Block:
    """One row for each area that a person drew."""
    columns = [Column(say("Correction"), left=True), Column(say("Reason"), left=True, wide=True)]
    columns += [Column(say("Survey"), left=True), Column(say("Area (m²)"))]
    table: list[list[Cell]] = [
        [
            say(corrections.LABELS.get(row["action"], "")),
            row["reason"] or "–",
            row["epoch"] or say("all"),
            figure(row, "area_m2", digits=1),
        ]
        for row in rows
    ]
    words = say("A person drew these areas. Excluded areas are in no zone, no sum and no registration.")
    return blocks.table(columns, table, words)


def _files(record: Mapping[str, Any]) -> Block:
    columns = [
        Column(say("File"), left=True),
        Column(say("File name"), left=True, wide=True),
        Column("SHA-256", left=True),
    ]
    rows: list[list[Cell]] = [
        [
            role_words(str(i["role"])),
            PurePosixPath(str(i.get("path", "")).replace("\\", "/")).name,
            str(i.get("sha256", "")),
        ]
        for i in record["inputs"]
    ]
    return blocks.table(columns, rows, size=6.0)
