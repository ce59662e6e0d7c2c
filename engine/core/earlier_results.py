"""What an output folder holds already: refused, unless it is to be replaced, or a series that goes on."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ...interface.input_files import RECORD
from ...interface.parameters import AUTO, DetailParameters
from .errors import InputError
from .input_files import read_input
from .json_shapes import anything, fields, maybe, number, parse_json, rows, table, text
from .json_values import plain
from .run_record import RunRecord

_NUMBERS = ("dz_mean_m", "dz_err_m", "vol_net_m3", "vol_err_m3", "motion_m", "alert_level")
_SERIES = fields(
    {"command": text(), "inputs": rows(fields({"role": text()}, {"sha256": text()}))},
    {
        "parameters": table(table(anything)),
        "zones": maybe(rows(fields({"zone_id": text()}, {"area_m2": maybe(number())}))),
        "course": maybe(table(rows(fields({"epoch": text()}, dict.fromkeys(_NUMBERS, number()))))),
    },
)
"""What is read of an earlier run's record."""


def refuse_results(folder: Path, names: Iterable[str], *, overwrite: bool = False) -> None:
    """Raise InputError if ``folder`` holds results and these are not to be overwritten; to be called before any work.

    What a stopped run may have left (its hidden folder, what a series or a training keeps to go on from) is no result.

    Args:
        names: outputs, from the folder, any of which are results.
    """
    found = next((name for name in names if os.path.lexists(Path(folder) / name)), None)
    if found is not None and not overwrite:
        raise InputError(
            f"The folder {folder} holds results already ({found}); choose another one, or give --overwrite to replace "
            "them."
        )


def earlier_series(folder: Path) -> dict[str, Any] | None:
    """The run record of the series that ``folder`` holds; None if it holds none."""
    try:
        record = parse_json(read_input(Path(folder) / "run.json", RECORD))
        _SERIES(record, "")
    except (InputError, ValueError):
        return None
    return dict(record) if record["command"] == "series" else None


def refuse_another_series(folder: Path, earlier: dict[str, Any], record: RunRecord) -> None:
    """Raise InputError unless the series of ``record`` goes on with the one that ``folder`` holds.

    It does where all surveys of before are given again, with the same settings, region and stable ground. Another
    table of alert levels only names the results differently.

    Args:
        earlier: the run record in the folder.
    """
    reason = _difference(earlier, record)
    if reason:
        raise InputError(
            f"The folder {folder} holds another series ({reason}); choose another one, or give --overwrite to replace "
            "it."
        )


def _difference(earlier: dict[str, Any], record: RunRecord) -> str:
    before, now = (
        {str(i.get("role")): i.get("sha256") for i in inputs if i.get("role") != "alerts"}
        for inputs in (earlier["inputs"], record.inputs)
    )
    for role in sorted({*before, *now}):
        survey = role.startswith("epoch ")
        if role not in now:
            return f"its {role.replace('epoch', 'survey of')} is not given now"
        if before.get(role) != now[role] and (role in before or not survey):
            return f"the {role.replace('epoch', 'survey of')} was another file"
    parameters = plain(record.parameters)
    for group, values in _with_ground(earlier.get("parameters", {})).items():
        if group == DetailParameters.record_name:  # what a report says of the slope changes no result
            continue
        for name, value in values.items():
            # a version may know parameters that the other does not
            if name in parameters.get(group, {}) and not _same(parameters[group][name], value):
                return f"{name} was {value}"
    return ""


def _with_ground(parameters: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """The parameters of a series with which points were its ground; earlier versions had two choices only."""
    if "ground" not in parameters:
        return parameters
    ready = parameters.get("series", {}).get("ground_ready", False)
    return parameters | {"ground": {"ground": "as_is" if ready else "extract"} | parameters["ground"]}


def _same(value: Any, earlier: Any) -> bool:
    return bool(value == earlier) or (value == AUTO and earlier in (0, -1))  # earlier versions wrote numbers for it
