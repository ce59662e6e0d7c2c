"""The report of a training, as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..configuration import CLASSES


def training_report(facts: dict[str, Any], metrics: dict[str, Any], digest: str, warnings: Sequence[str]) -> str:
    """What was trained on what, and how good it is on what it was not trained on.

    Args:
        facts: as ``command.training_facts`` makes them.
        metrics: ``cross_validation`` (``fine_tuning.pooled_scores``) and ``calibration``, None where there is none.
        digest: SHA-256 of the weights.
    """
    start = facts["start"]
    origin = f"the weights {start['name']} (SHA-256 {start['sha256'][:12]}…)" if start else "nothing"
    lines = [
        "# Training report",
        "",
        f"Trained from {origin}, {facts['steps']} steps a training. The new weights have the SHA-256 {digest}.",
        "",
        *(f"**Note:** {warning}  " for warning in warnings),
        "",
        "## Files",
        "",
        *_table(
            ["file", *CLASSES, "unknown", "points/m²", "SHA-256"],
            [
                [
                    file["name"],
                    *(f"{file['points'][name]:,}" for name in (*CLASSES, "unknown")),
                    f"{file['density']:.0f}",
                    file["sha256"][:12] + "…",
                ]
                for file in facts["files"]
            ],
        ),
        "",
        "## Scores",
        "",
    ]
    scores = metrics["cross_validation"]
    if scores is None:
        lines.append("None. With one file there is nothing to score on that was not trained on, nor to calibrate with.")
        return "\n".join(lines) + "\n"
    lines.append(
        f"Each file was scored once, by a model that never saw it ({len(facts['folds'])} folds). The weights written "
        "are trained on all files; expect them to be about as good on slopes like these, and worse on others."
    )
    return (
        "\n".join([*lines, *_score_lines(scores, facts["folds"]), *_calibration_lines(metrics["calibration"])]) + "\n"
    )


def _score_lines(scores: dict[str, Any], folds: Sequence[Any]) -> list[str]:
    return [
        "",
        *_table(["all held-out points", "accuracy", "mean IoU", *(f"IoU {name}" for name in CLASSES)], _rows(scores)),
        "",
        *_table(
            ["fold", "scored on", "accuracy", "mean IoU"],
            [
                [str(number + 1), ", ".join(fold["test"]), _percent(result["overall_accuracy"]),
                 _percent(result["mean_iou"])]
                for number, (fold, result) in enumerate(zip(folds, scores["folds"]))
            ],
        ),
        "",
        "Points by class, all held-out points: rows are the labels, columns what the model said.",
        "",
        *_table(
            ["", *CLASSES],
            [[name, *(f"{n:,}" for n in row)] for name, row in zip(CLASSES, scores["confusion"])],
        ),
        "",
    ]  # fmt: skip


def _calibration_lines(found: dict[str, Any]) -> list[str]:
    return [
        "## Calibration",
        "",
        (
            f"Temperature {found['temperature']:.3f}, fitted on {found['points']:,} held-out points: mean negative "
            f"log-likelihood {found['nll_before']:.3f} → {found['nll_after']:.3f}, expected calibration error "
            f"{_percent(found['error_before'])} → {_percent(found['error_after'])} (on the points of the fit)."
        ),
    ]


def _rows(scores: dict[str, Any]) -> list[list[str]]:
    def row(name: str, prefix: str) -> list[str]:
        figures = [scores[f"{prefix}overall_accuracy"], scores[f"{prefix}mean_iou"]]
        return [name, *map(_percent, figures), *(_percent(scores[f"{prefix}iou"][c]) for c in CLASSES)]

    rows = [row("trained", "")]
    if "start_iou" in scores:
        rows.append(row("the weights it started from", "start_"))
    return [*rows, ["the most frequent class everywhere", _percent(scores["majority_accuracy"]), "", "", "", ""]]


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.1f} %"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    escaped = [[cell.replace("|", "\\|") for cell in row] for row in rows]
    lines = [head, ["---"] * len(head), *escaped]
    return [f"| {' | '.join(line)} |" for line in lines]
