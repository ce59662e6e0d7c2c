"""Folds by scene, and a validation that goes on where it stopped."""

from __future__ import annotations

import json

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.models.training.cross_validation import cross_validate, folds
from slopewatch.models.training.evaluation import LabelScores, confusion


def test_each_scene_is_scored_once_and_never_trained_on_in_the_same_fold():
    found = folds(92, 5, seed=1)
    assert sorted(k for fold in found for k in fold.test) == list(range(92))
    assert sorted(len(fold.test) for fold in found) == [18, 18, 18, 19, 19]
    for fold in found:
        assert not set(fold.test) & set(fold.train)
        assert len(fold.train) + len(fold.test) == 92
    assert found == folds(92, 5, seed=1)
    assert found != folds(92, 5, seed=2)


def test_too_few_scenes_or_folds_are_refused():
    for scenes, count in ((3, 5), (3, 1)):
        with pytest.raises(InputError, match="cannot be split"):
            folds(scenes, count)


def test_folds_that_are_done_are_not_done_again(tmp_path):
    calls = []

    def train_and_score(fold, folder):
        calls.append(fold.number)
        assert folder.is_dir()
        if len(calls) == 3:
            raise KeyboardInterrupt
        scores = LabelScores()
        right = 60 + 10 * fold.number
        truth = np.zeros(100, dtype=np.uint8)
        scores.counts += confusion(truth, np.where(np.arange(100) < right, 0, 1).astype(np.uint8))
        return scores

    chosen = folds(9, 3)
    with pytest.raises(KeyboardInterrupt):
        cross_validate(chosen, tmp_path, train_and_score)
    summary = cross_validate(chosen, tmp_path, train_and_score)
    assert calls == [0, 1, 2, 2]
    assert summary["overall_accuracy"] == {"mean": 0.7, "lowest": 0.6, "highest": 0.8}
    assert json.loads((tmp_path / "folds.json").read_text())["overall_accuracy"]["mean"] == 0.7
    with pytest.raises(InputError, match="other scenes"):
        cross_validate(folds(9, 3, seed=5), tmp_path, train_and_score)
