"""Folds by scene: all points of a scene are either trained on or scored."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...engine.core.errors import InputError
from ...engine.core.staged_outputs import atomic_output
from .evaluation import LabelScores


@dataclass(frozen=True)
class Fold:
    """Numbers of the scenes that are trained on and of those that are scored, each rising."""

    number: int
    train: tuple[int, ...]
    test: tuple[int, ...]


def folds(scenes: int, count: int = 5, seed: int = 0) -> list[Fold]:
    """Each scene is scored in exactly one of ``count`` folds; sizes differ by at most one.

    Raises:
        InputError: fewer scenes than folds, or fewer than two folds.
    """
    if count < 2 or scenes < count:
        raise InputError(f"{scenes} scenes cannot be split into {count} folds; give more scenes or fewer folds.")
    order = np.random.default_rng([seed, count]).permutation(scenes)
    tests = [tuple(sorted(int(k) for k in part)) for part in np.array_split(order, count)]
    return [
        Fold(number, tuple(k for k in range(scenes) if k not in set(test)), test) for number, test in enumerate(tests)
    ]


def cross_validate(
    chosen: Sequence[Fold], folder: Path, train_and_score: Callable[[Fold, Path], LabelScores]
) -> dict[str, Any]:
    """Train and score fold by fold; folds whose scores are already in ``folder`` are not done again.

    ``train_and_score`` trains on a fold's scenes in the folder given and scores the others. The summary has each fold's
    scores and the mean and range over the folds of accuracy and mean IoU; it is also written to ``folder/folds.json``.
    """
    results = []
    for fold in chosen:
        place = folder / f"fold_{fold.number}"
        place.mkdir(parents=True, exist_ok=True)
        path = place / "scores.json"
        if not path.is_file():
            scores = train_and_score(fold, place).summary()
            with atomic_output(path) as partial:
                partial.write_text(json.dumps({"test": fold.test, **scores}, indent=2), encoding="utf-8")
        result = json.loads(path.read_text(encoding="utf-8"))
        if tuple(result["test"]) != fold.test:
            raise InputError(f"{path} holds the scores of other scenes; choose another folder or remove it.")
        results.append(result)
    summary: dict[str, Any] = {"folds": results}
    for name in ("overall_accuracy", "mean_iou"):
        values = [result[name] for result in results]
        summary[name] = {"mean": round(float(np.mean(values)), 4), "lowest": min(values), "highest": max(values)}
    # A class that is in none of a fold's scenes has no score there.
    iou = {name: [r["iou"][name] for r in results if r["iou"][name] is not None] for name in results[0]["iou"]}
    summary["iou"] = {name: round(float(np.mean(values)), 4) if values else None for name, values in iou.items()}
    with atomic_output(folder / "folds.json") as partial:
        partial.write_text(json.dumps(summary, indent=2), encoding="utf-8")
    return summary
