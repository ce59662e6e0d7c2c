"""Exports of Label Studio, made by hand in its real format, and masks packed as its editor packs them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np


def packed(words: Sequence[int], sizes: Sequence[int] = (3, 4, 8, 16), word: int = 8) -> list[int]:
    """Words in the format of @thi.ng/rle-pack, written from its description: repeated words, and words as they are."""
    bits = f"{len(words):032b}{word - 1:05b}" + "".join(f"{size - 1:04b}" for size in sizes)
    runs: list[tuple[bool, list[int]]] = []
    for value in words:
        if runs and runs[-1][1][-1] == value and len(runs[-1][1]) < 2 ** max(sizes):
            if runs[-1][0] or len(runs[-1][1]) == 1:
                runs[-1] = (True, [*runs[-1][1], value])
                continue
            runs[-1][1].pop()
            runs.append((True, [value, value]))
        elif runs and not runs[-1][0] and len(runs[-1][1]) < 2 ** max(sizes):
            runs[-1][1].append(value)
        else:
            runs.append((False, [value]))
    for repeated, values in runs:
        choice = next(k for k, size in enumerate(sizes) if len(values) <= 2**size)
        bits += f"{int(repeated)}{choice:02b}{len(values) - 1:0{sizes[choice]}b}"
        bits += "".join(f"{v:0{word}b}" for v in (values[:1] if repeated else values))
    bits += "0" * (-len(bits) % 8)
    return [int(bits[k : k + 8], 2) for k in range(0, len(bits), 8)]


def painted(mask: np.ndarray) -> list[int]:
    """A mask (rows, columns) as the editor writes it: all four bands are the opacity."""
    return packed(np.repeat(mask.astype(np.uint8).ravel() * 255, 4).tolist())


def result(kind: str, value: dict[str, Any], size: tuple[int, int], region: str = "aBcDeF1234", **more: Any) -> Any:
    """A result of an annotation; ``size`` is the picture's (width, height)."""
    return {
        "original_width": size[0],
        "original_height": size[1],
        "image_rotation": 0,
        "value": value,
        "id": region,
        "from_name": kind.removesuffix("labels"),
        "to_name": "picture",
        "type": kind,
        "origin": "manual",
    } | more


def polygon(points: Any, label: str, size: tuple[int, int], region: str = "aBcDeF1234", **more: Any) -> Any:
    """``points``: (n, 2) per cent of the picture."""
    value = {"points": np.asarray(points).tolist(), "closed": True, "polygonlabels": [label]}
    return result("polygonlabels", value, size, region, **more)


def task(results: list[Any], image: str = "/data/upload/7/0a1b2c3d-top_view.png", number: int = 1, **more: Any) -> Any:
    """A task of an export as JSON, with one annotation."""
    return {
        "id": number,
        "annotations": [
            {
                "id": 100 + number,
                "completed_by": {"id": 3, "email": "a.sato@example.org"},
                "result": results,
                "was_cancelled": False,
                "ground_truth": False,
                "created_at": "2025-06-01T08:00:00.000000Z",
                "lead_time": 12.5,
            }
        ],
        "file_upload": "0a1b2c3d-top_view.png",
        "drafts": [],
        "predictions": [],
        "data": {"image": image},
        "meta": {},
        "project": 7,
    } | more


def write_export(path: Path, tasks: Any) -> Path:
    path.write_text(json.dumps(tasks), encoding="utf-8")
    return path
