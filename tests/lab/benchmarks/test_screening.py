"""Scores that are kept become rows, and targets are judged by them."""

from __future__ import annotations

import json

import pytest

pytest.importorskip("torch", reason="torch is not installed; install slopewatch[screening]")
from slopewatch.lab.benchmarks.screening import score_rows


def _write(folder, name, **values):
    (folder / f"{name}.json").write_text(json.dumps(values))


def _folds(mean):
    return {k: {"mean": mean, "lowest": mean - 0.02, "highest": mean + 0.02} for k in ("mean_iou", "overall_accuracy")}


def _scores(mean_iou, found, false, drains, error):
    return {
        "mean_iou": mean_iou,
        "recall_15_cm_2_m": {"recall": found, "hazards": 100},
        "false_zones_per_1000_m2": false,
        "false_zones": {"drain": drains, "none": 3},
        "scenes": 40,
        "calibration_error": error,
    }


def _met(rows):
    return {row.figure: row.met for row in rows}


def test_targets_are_judged_by_the_scores_kept(tmp_path):
    _write(tmp_path, "folds_slopewatch", **_folds(0.71))
    _write(tmp_path, "folds_paper", **_folds(0.55))
    _write(tmp_path, "realistic_slopewatch", **_scores(0.6, 0.95, 0.8, 4, 0.03))
    _write(tmp_path, "shifted_slopewatch", **_scores(0.52, 0.5, 2.0, 1, 0.2))
    met = _met(score_rows(tmp_path))
    assert met.pop("published set, 5 folds: accuracy") is False
    assert met.pop("realistic set: mean IoU") is None
    assert len(met) == 7
    assert all(met.values())


def test_missed_targets_are_reported(tmp_path):
    _write(tmp_path, "folds_slopewatch", **_folds(0.69))
    _write(tmp_path, "folds_paper", **_folds(0.58))
    _write(tmp_path, "realistic_slopewatch", **_scores(0.6, 0.85, 1.2, 5, 0.06))
    _write(tmp_path, "shifted_slopewatch", **_scores(0.45, 0.5, 2.0, 1, 0.2))
    met = _met(score_rows(tmp_path))
    assert met.pop("realistic set: mean IoU") is None
    assert set(met.values()) == {False}


def test_what_was_not_scored_has_no_row(tmp_path):
    assert score_rows(tmp_path) == []
