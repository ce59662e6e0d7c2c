"""The summary against a case worked out by hand, and against what the software that named its lines would show."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from slopewatch.engine.statistics.variogram import VariogramModel
from slopewatch.engine.zones.footprints import Cells, outline_footprints
from slopewatch.engine.zones.gcd_table import VolumeTable, table_frame, volume_table, write_volume_table
from slopewatch.engine.zones.volumes import CorrelationModel, zone_volumes
from slopewatch.tests.builders.change_zones import single

NAN = np.nan
# Cells of 2 m; level 0.15 m.
DZ = np.array(
    [
        [-0.50, -0.30, -0.10, NAN],
        [-0.20, 0.10, 0.00, NAN],
        [0.05, 0.40, 0.60, -0.05],
    ]
)
ERROR, REGISTRATION = 0.05, 0.03


def table(variogram: VariogramModel | None = None) -> VolumeTable:
    cells = Cells(DZ, np.where(np.isnan(DZ), NAN, ERROR), np.full(DZ.shape, 4.0), single(DZ, 2.0))
    model = CorrelationModel(REGISTRATION, variogram)
    significant = np.nan_to_num(np.abs(DZ)) > 0.15
    labels = np.where(significant, np.where(DZ < 0, 1, 2), 0).astype(np.int32)
    zones = zone_volumes(outline_footprints(cells, labels, 2, gap=0.0), cells, model)
    return volume_table(cells, significant, zones, model)


def lines(found: VolumeTable) -> dict[str, dict[str, float | None]]:
    keys = ("raw", "raw_error", "thresholded", "standard_error", "low_95", "high_95", "error_percent")
    return {f"{row.group[:4]} {row.quantity}": {key: getattr(row, key) for key in keys} for row in found.rows()}


def test_the_lines_of_a_case_worked_out_by_hand() -> None:
    found = lines(table(VariogramModel(1.0)))
    expected = {
        "AREA Total Area of Surface Lowering": (20.0, 12.0),
        "AREA Total Area of Surface Raising": (16.0, 8.0),
        "AREA Total Area of Detectable Change": (None, 20.0),
        "AREA Total Area of Interest": (40.0, None),
        "AREA Percent of Area of Interest with Detectable Change": (None, 50.0),
        "VOLU Total Volume of Surface Lowering": (4.6, 4.0),
        "VOLU Total Volume of Surface Raising": (4.6, 4.0),
        "VOLU Total Volume of Difference": (9.2, 8.0),
        "VOLU Total Net Volume Difference": (0.0, 0.0),
        "VERT Average Depth of Surface Lowering": (0.23, 1 / 3),
        "VERT Average Depth of Surface Raising": (0.2875, 0.5),
        "VERT Average Total Thickness of Difference for Area of Interest": (0.23, 0.2),
        "VERT Average Net Thickness of Difference for Area of Interest": (0.0, 0.0),
        "VERT Average Total Thickness of Difference for Area with Detectable Change": (None, 0.4),
        "VERT Average Net Thickness of Difference for Area with Detectable Change": (None, 0.0),
        "PERC Percent Elevation Lowering": (50.0, 50.0),
        "PERC Percent Elevation Raising": (50.0, 50.0),
        "PERC Percent Imbalance (departure from equilibrium)": (0.0, 0.0),
        "PERC Net to Total Volume Ratio": (0.0, 0.0),
    }
    assert [name for name in found if not name.startswith("ZONE")] == list(expected)
    for name, (raw, kept) in expected.items():
        assert found[name]["raw"] == (None if raw is None else pytest.approx(raw, abs=1e-12)), name
        assert found[name]["thresholded"] == (None if kept is None else pytest.approx(kept, abs=1e-12)), name
    interval = ("standard_error", "low_95", "high_95", "error_percent")
    for name in expected:
        assert [found[name][column] for column in interval] == [None] * 4, "noise alone makes these sums"
        assert (found[name]["raw_error"] is None) == (
            "Net Volume" not in name and "Net Thickness of Difference for Area of" not in name
        )
    assert found["VOLU Total Net Volume Difference"]["raw_error"] == pytest.approx(
        4 * np.hypot(0.04 * np.sqrt(10), 0.3)
    )


def test_fully_correlated_errors_add_up() -> None:
    line = lines(table())["VOLU Total Net Volume Difference"]
    assert line["raw_error"] == pytest.approx(10 * 4 * np.hypot(0.04, REGISTRATION))


def test_the_zones_volumes_are_those_over_footprints() -> None:
    found = table(VariogramModel(1.0))
    rows = lines(found)
    lowering, raising, net = (
        rows[f"ZONE {name}"]
        for name in (
            "Total Volume of Surface Lowering",
            "Total Volume of Surface Raising",
            "Total Net Volume Difference",
        )
    )
    # nine of the ten measured cells lie nearer to one zone; none is farther than two cells from its own
    assert raising["thresholded"] - lowering["thresholded"] == pytest.approx(net["thresholded"])
    assert found.figures()["vol_loss_m3"] == lowering["thresholded"] > 3.9
    assert found.figures()["vol_gain_err_m3"] == raising["standard_error"] > 0
    for line in (lowering, raising):
        assert line["low_95"] == pytest.approx(line["thresholded"] - 1.959964 * line["standard_error"], abs=1e-6)
        assert line["high_95"] == pytest.approx(line["thresholded"] + 1.959964 * line["standard_error"], abs=1e-6)


def test_nothing_measured_beyond_its_level_leaves_no_percentages() -> None:
    cells = Cells(np.zeros((4, 4)), np.full((4, 4), 0.05), np.ones((4, 4)), single(np.ones((4, 4))))
    model = CorrelationModel(0.01, VariogramModel(1.0))
    found = lines(volume_table(cells, np.zeros((4, 4), dtype=bool), zone_volumes((), cells, model), model))
    assert found["PERC Percent Elevation Lowering"]["thresholded"] is None
    assert found["VERT Average Depth of Surface Lowering"]["thresholded"] is None
    assert found["VOLU Total Net Volume Difference"]["thresholded"] == 0.0
    # the surface as a whole is known to an error all the same
    assert found["VOLU Total Net Volume Difference"]["raw_error"] == pytest.approx(
        16 * np.hypot(np.sqrt(0.0024) / 4, 0.01)
    )


def test_nothing_summed_up_has_no_error_and_no_sign(tmp_path: Path) -> None:
    cells = Cells(np.full((4, 4), -1e-9), np.full((4, 4), 0.05), np.ones((4, 4)), single(np.ones((4, 4))))
    model = CorrelationModel(0.01, VariogramModel(1.0))
    found = volume_table(cells, np.zeros((4, 4), dtype=bool), zone_volumes((), cells, model), model)
    for name in ("VOLU Total Volume of Surface Lowering", "ZONE Total Volume of Surface Lowering"):
        line = lines(found)[name]
        assert line["thresholded"] == 0.0
        assert [line[column] for column in ("standard_error", "low_95", "high_95")] == [None] * 3
    write_volume_table(tmp_path / "volumes.csv", found)
    assert not re.search(r"(^|,)-0(\.0*)?(,|$)", (tmp_path / "volumes.csv").read_text(), re.MULTILINE)


def test_the_file_holds_what_the_table_does(tmp_path: Path) -> None:
    found = table(VariogramModel(1.0))
    write_volume_table(tmp_path / "volumes.csv", found)
    with (tmp_path / "volumes.csv").open(encoding="utf-8", newline="") as file:
        read = list(csv.DictReader(file))
    assert len(read) == len(found.rows()) == len(table_frame(found))
    for line, row in zip(read, found.rows(), strict=True):
        assert (line["group"], line["quantity"], line["unit"]) == (row.group, row.quantity, row.unit)
        for name in ("raw", "thresholded", "standard_error", "error_percent"):
            value = getattr(row, name)
            assert line[name] == "" if value is None else float(line[name]) == pytest.approx(value, abs=1e-6)
    assert b"\r" not in (tmp_path / "volumes.csv").read_bytes()
