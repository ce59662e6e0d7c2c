"""Screening: its scores on the benchmark sets, and the time and memory of the whole job on a million ground points.

Training and scoring take hours on a processor, so that the scores are those kept next to the weights, each made again
by one command (``python -m slopewatch.lab.making``); speed and memory are measured now.
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path
from typing import Any

from ...models.network.shipped import SHIPPED_WEIGHTS
from ...simulation.hazard_scenes.scenes import build_scene, scene
from ...simulation.hazard_scenes.sets import published_set
from ...simulation.hazard_scenes.write import write_scene
from .table import Row
from .watched import run_watched

POINTS = 1_000_000
SIMULATED = 5
"""Scenes of the published set that the simulation's speed is measured on."""
FIGURES = SHIPPED_WEIGHTS.with_name("figures")


def rows() -> list[Row]:
    """Scores, then speed."""
    return [*score_rows(FIGURES), *_speed()]


def score_rows(folder: Path) -> list[Row]:
    """The scores kept in ``folder`` and their targets; those that are not there are left out."""
    kept = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("*.json")}
    result = []
    folds = {name: kept.get(f"folds_{name}") for name in ("slopewatch", "paper", "residual")}
    if folds["slopewatch"]:
        own, paper = folds["slopewatch"], folds["paper"]
        others = "; ".join(
            f"{title} {_range(scores['mean_iou'])}"
            for title, scores in (("published pipeline, same time", paper), ("threshold", folds["residual"]))
            if scores
        )
        result.append(
            Row("published set, 5 folds: mean IoU", _range(own["mean_iou"]), ">= 70 %", others, _mean(own) >= 0.70)
        )
        if paper:
            lead = _mean(own) - _mean(paper)
            result.append(
                Row(
                    "its lead over the published pipeline", f"{100 * lead:.1f} points", ">= 15 points", "", lead >= 0.15
                )
            )
        accuracy = own["overall_accuracy"]["mean"]
        result.append(
            Row("published set, 5 folds: accuracy", _range(own["overall_accuracy"]), ">= 82 %", "", accuracy >= 0.82)
        )
    sets = {name: kept.get(f"{name}_slopewatch") for name in ("realistic", "shifted")}
    if sets["realistic"]:
        result += _realistic(sets["realistic"], kept.get("realistic_residual"))
    if sets["realistic"] and sets["shifted"]:
        gap = sets["realistic"]["mean_iou"] - sets["shifted"]["mean_iou"]
        result.append(
            Row(
                "shifted set: mean IoU below the realistic set's",
                f"{100 * gap:.1f} points ({_percent(sets['shifted']['mean_iou'])})",
                "at most 10 points",
                "",
                gap <= 0.10,
            )
        )
    return result


def _realistic(scores: dict[str, Any], residual: dict[str, Any] | None) -> list[Row]:
    found, false = scores["recall_15_cm_2_m"]["recall"], scores["false_zones_per_1000_m2"]
    drains = sum(scores["false_zones"].get(kind, 0) for kind in ("drain", "beam"))
    error = scores["calibration_error"]
    others = ["", "", ""]
    if residual:
        others = [
            f"threshold {_percent(residual['recall_15_cm_2_m']['recall'])}",
            f"threshold {residual['false_zones_per_1000_m2']:.2f}",
            f"threshold {_percent(residual['mean_iou'])}",
        ]
    return [
        Row("realistic set: mean IoU", _percent(scores["mean_iou"]), "", others[2]),
        Row("realistic set: hazards >= 15 cm, >= 2 m found", _percent(found), ">= 90 %", others[0], found >= 0.9),
        Row("realistic set: false zones / 1,000 m²", f"{false:.2f}", "<= 1", others[1], false <= 1),
        Row(
            "realistic set: false zones on drains and beams",
            f"{10 * drains / scores['scenes']:.1f} in 10 scenes",
            "<= 1 in 10 scenes",
            "",
            drains <= 0.1 * scores["scenes"],
        ),
        Row("realistic set: calibration error", _percent(error), "<= 5 %", "", error <= 0.05),
    ]


def _speed() -> list[Row]:
    specs = published_set().specs[:SIMULATED]
    start = time.process_time()
    simulated = sum(len(build_scene(spec)) for spec in specs)
    rate = simulated / (time.process_time() - start)
    result = [
        Row(
            f"simulating {len(specs)} published scenes of {simulated / 1e6:.1f} M points, one core's time",
            f"{rate / 1e6:.2f} M points/s",
            "at least 1 M points/s",
            "",
            rate >= 1e6,
        )
    ]
    ground = scene(1, "realistic", area=POINTS / 150, density=150.0)
    with tempfile.TemporaryDirectory() as name:
        cloud, output = Path(name) / "ground.laz", Path(name) / "screened.laz"
        write_scene(cloud, ground)
        seconds, memory = {}, 0
        for method in ("relief", "network", "residual"):
            seconds[method], peak = run_watched(
                ["screen", str(cloud), "--output", str(output), "--method", method, "--progress", "none"]
            )
            memory = max(memory, peak)
            output = output.with_name("again.laz")
    rates = {method: len(ground) / taken for method, taken in seconds.items()}
    title = f"screening {len(ground) / 1e6:.2f} M ground points, LAZ to labelled LAZ"
    return [
        *result,
        Row(title, f"{rates['relief']:,.0f} points/s", "at least 80,000 points/s", "", rates["relief"] >= 80_000),
        Row(
            f"{title}, by the network on points",
            f"{rates['network']:,.0f} points/s",
            "at least 60,000 points/s",
            f"threshold without learning {rates['residual']:,.0f} points/s",
            rates["network"] >= 60_000,
        ),
        Row("its peak memory", f"{memory / 1e9:.2f} GB", "at most 3 GB", "", memory <= 3e9),
    ]


def _mean(scores: dict[str, Any]) -> float:
    return float(scores["mean_iou"]["mean"])


def _range(values: dict[str, float]) -> str:
    return f"{100 * values['mean']:.1f} % ({100 * values['lowest']:.1f} to {100 * values['highest']:.1f})"


def _percent(value: float) -> str:
    return f"{100 * value:.1f} %"
