"""Scores on scenes, of predictions whose faults are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.lab.making.scene_scores import SceneScores, hazard_recalls, screened_zones
from slopewatch.simulation.hazard_scenes.negatives import Negative


def certain(labels):
    return np.eye(3)[labels] * 0.98 + 0.01 * (1 - np.eye(3)[labels])


def test_a_perfect_screening_has_perfect_scores(small_scene):
    scores = SceneScores()
    scores.add(small_scene, certain(small_scene.label))
    summary = scores.summary()
    assert summary["overall_accuracy"] == summary["mean_iou"] == 1.0
    assert summary["false_zones"] == {}
    assert summary["false_zones_per_1000_m2"] == 0.0
    assert scores.recall()[0] == 1.0
    assert scores.recall()[1] == len(hazard_recalls(small_scene, small_scene.label)) > 3
    assert scores.zones > 3
    assert summary["calibration_error"] == pytest.approx(0.02, abs=1e-3)
    assert set(summary["wrong_share_by_negative"].values()) == {0.0}


def test_hazards_are_found_by_half_of_their_points(small_scene):
    """Of every hazard the first 40 %, or 60 %, of the points are called by their class."""
    for share, recall in ((0.4, 0.0), (0.6, 1.0)):
        predicted = small_scene.label.copy()
        for row in small_scene.hazards:
            mine = np.flatnonzero((small_scene.hazard == row["id"]) & (small_scene.label > 0))
            predicted[mine[int(np.ceil(share * len(mine))) :]] = 0
        scores = SceneScores()
        scores.add(small_scene, certain(predicted))
        assert scores.recall()[0] == pytest.approx(recall, abs=0.13)
    # Sizes and amplitudes divide the hazards.
    summary = scores.summary()
    for name in ("recall_by_amplitude_m", "recall_by_size_m"):
        assert sum(row["hazards"] for row in summary[name].values()) == scores.recall()[1]
    assert scores.recall(0.15, 2.0)[1] <= scores.recall(0.15)[1] <= scores.recall()[1]


def test_false_zones_are_counted_and_named_after_what_they_lie_on(small_scene):
    clean = replace(small_scene, label=np.zeros_like(small_scene.label), hazards=small_scene.hazards[:0])
    plane = clean.to_plane(clean.xyz)
    middle = np.median(plane[:, :2], axis=0)
    inside = np.linalg.norm(plane[:, :2] - middle, axis=1) < 1.2
    for kind in (Negative.DRAIN, Negative.NONE):
        negative = np.zeros_like(clean.negative)
        negative[inside] = kind
        marked = replace(clean, negative=negative)
        zones, false = screened_zones(marked, inside.astype(np.uint8))
        assert zones == 1
        assert false == [kind.name.lower()]
    # Next to a true hazard of the same class it is none; of the other class it is.
    truth = replace(clean, label=np.where(inside & (plane[:, 0] < middle[0]), 1, 0).astype(np.uint8))
    assert screened_zones(truth, inside.astype(np.uint8)) == (1, [])
    assert len(screened_zones(truth, 2 * inside.astype(np.uint8))[1]) == 1
    # A single stray point is no zone.
    stray = np.zeros(len(clean), dtype=np.uint8)
    stray[np.flatnonzero(inside)[0]] = 1
    assert screened_zones(clean, stray) == (0, [])
    scores = SceneScores()
    scores.add(marked, certain(inside.astype(np.uint8)))
    assert scores.summary()["false_zones_per_1000_m2"] == pytest.approx(1000 / clean.area, abs=1e-3)
