"""Rows of the table of motion along the surface, from what each case gave (``displacement``)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...engine.core.arrays import Float
from ...engine.displacement.vectors import threshold
from .table import Row

Case = Mapping[str, Any]
MAX_CORE_ERROR_M = 0.1
REPORTED, OURS, ICP = "reported", "displacement", "patch-wise ICP"
MAX_RATIO_TO_ICP = 0.8


@dataclass(frozen=True)
class Windows:
    """Windows of one width on one map: ``error`` (n, 2) across and along the dip, ``stated`` (n, 2) standard errors,
    metres, ``statistic`` (n,) of the motion's error, ``usable`` the share of all windows.
    """

    error: Float
    stated: Float
    statistic: Float
    usable: float

    def as_lists(self) -> dict[str, Any]:
        """For a file; six digits."""
        figures = {"error": self.error, "stated": self.stated, "statistic": self.statistic}
        return {k: np.round(v, 6).tolist() for k, v in figures.items()} | {"usable": self.usable}

    @classmethod
    def of(cls, cases: Sequence[Case], size: float | str) -> Windows:
        """Of all ``cases`` together; ``REPORTED`` or a width in metres."""
        found = [case["windows"][size if isinstance(size, str) else f"{size:g}"] for case in cases]
        error, stated = (np.concatenate([np.reshape(f[key], (-1, 2)) for f in found]) for key in ("error", "stated"))
        statistic = np.concatenate([f["statistic"] for f in found])
        return cls(error, stated, statistic, float(np.mean([f["usable"] for f in found])))

    @property
    def rms_mm(self) -> Float:
        """(2,) across and along the dip."""
        return np.asarray(1000 * np.sqrt((self.error**2).mean(axis=0)))


def window_rows(
    name: str, size: float | str, cases: Sequence[Case], targets: tuple[float, float] | None
) -> Iterator[Row]:  # fmt: skip
    """Errors, their honesty and false motion of windows as ``REPORTED`` or of ``size`` metres; ``targets`` across and
    along, mm.
    """
    windows = Windows.of(cases, size)
    label = f"{name}, as reported" if isinstance(size, str) else f"{name}, windows of {size:g} m"
    if not len(windows.error):
        yield Row(label, "no vector")
        return
    rms = windows.rms_mm
    within = 100 * (np.abs(windows.error) < 2 * windows.stated).mean(axis=0)
    false = 100 * float((windows.statistic > threshold(0.99)).mean())
    yield Row(
        f"{label} ({len(windows.error)}): rms error across / along the dip",
        f"{rms[0]:.1f} / {rms[1]:.1f} mm",
        f"≤ {targets[0]:g} / {targets[1]:g} mm" if targets else "",
        f"{100 * windows.usable:.0f} % of all windows have a vector",
        bool((rms <= targets).all()) if targets else None,
    )
    yield Row(
        "the same: within two standard errors, across / along",
        f"{within[0]:.1f} / {within[1]:.1f} %",
        "93 to 97 %",
        "",
        bool((within >= 93).all()),
    )
    yield Row("the same: windows falsely moving at nominal 1 %", f"{false:.2f} %", "≤ 1.5 %", "", false <= 1.5)


def still_rows(pairs: Sequence[Case], zones: Sequence[int], targets: Mapping[float, tuple[float, float]]) -> list[Row]:
    """Simulated pairs where nothing moved; ``zones`` of each still map."""
    found: list[Row] = []
    sizes: list[tuple[float | str, tuple[float, float] | None]] = [(REPORTED, None), *targets.items()]
    for size, target in sizes:
        found += window_rows("simulated, nothing moved", size, [pair["still"] for pair in pairs], target)
    claimed, shown, measured = np.sum([pair["still"]["reported"] for pair in pairs], axis=0).tolist()
    found.append(
        Row(
            "the same, both widths as they are reported: windows falsely moving at nominal 1 %",
            f"{100 * claimed / measured:.2f} % of {measured}", "≤ 1.5 %", f"{shown} are drawn",
            claimed <= 0.015 * measured,
        )
    )  # fmt: skip
    maps = sum(count > 0 for count in zones)
    under = sum(pair["still"]["zones"] > 0 for pair in pairs)
    found.append(
        Row(
            "still maps with a zone",
            f"{maps} of {len(zones)}",
            "≤ 5 %",
            f"{under} of {len(pairs)} under plants, {maps - under} of {len(zones) - len(pairs)} bare",
            maps <= 0.05 * len(zones),
        )
    )
    seconds = float(np.median([pair["still"]["seconds"] for pair in pairs]))
    found.append(Row("processor seconds per 1,000 m², both widths", f"{seconds:.1f} s", "≤ 3 s", "", seconds <= 3.0))
    return found


def moving_rows(pairs: Sequence[Case]) -> Iterator[Row]:
    """The ellipse moved down the dip: windows and zones that show it, and by how much they err."""
    targets = {("8", "0.1"): 95.0, ("8", "0.05"): 60.0}
    motions = list(pairs[0]["moved"])
    for size in pairs[0]["moved"][motions[0]]["shown"]:
        for motion in motions:
            shown = np.concatenate([pair["moved"][motion]["shown"][size] for pair in pairs])
            share, target = 100 * float(shown.mean()), targets.get((size, motion))
            yield Row(
                f"{100 * float(motion):.0f} cm down the dip: windows of {size} m that show it",
                f"{share:.0f} % of {len(shown)}",
                f"≥ {target:g} %" if target else "",
                "refused windows count as missed",
                share >= target if target else None,
            )
    for motion in motions:
        yield from _zone_rows(float(motion), [pair["moved"][motion] for pair in pairs])
    core = np.concatenate([pair["moved"][motion]["core"] for pair in pairs for motion in motions])
    wrong = int((core > MAX_CORE_ERROR_M).sum())
    yield Row(
        f"vectors in a zone's core wrong by more than {MAX_CORE_ERROR_M:g} m", f"{wrong} of {len(core)}", "0",
        f"largest error {core.max():.3f} m" if len(core) else "", wrong == 0,
    )  # fmt: skip


def _zone_rows(motion: float, cases: Sequence[Case]) -> Iterator[Row]:
    least = {0.05: 0.5, 0.1: 1.0}.get(motion)
    found = sum(case["zones"] > 0 for case in cases)
    yield Row(
        f"{100 * motion:.0f} cm: zone found", f"{found} of {len(cases)}",
        "" if least is None else f"≥ {100 * least:.0f} %", "",
        None if least is None else found >= least * len(cases),
    )  # fmt: skip
    biases = [100 * case["bias"] for case in cases if case["bias"] is not None]
    if biases:
        bias = float(np.mean(biases))
        yield Row(
            f"{100 * motion:.0f} cm: bias of the zones' motion along the dip", f"{bias:+.1f} %",
            "" if motion < 0.1 else "≤ 5 %", f"scatter {np.std(biases):.1f} %, {len(biases)} zones",
            None if motion < 0.1 else abs(bias) <= 5,
        )  # fmt: skip


def other_rows(pairs: Sequence[Case]) -> Iterator[Row]:
    """What others see of 10 cm in the ellipse's core."""
    for name in pairs[0]["others"]:
        values = [pair["others"][name] for pair in pairs]
        yield Row(f"10 cm down the dip as others see it: {name}", f"{100 * float(np.nanmean(values)):+.1f} cm")


def beside_rows(name: str, cases: Sequence[Mapping[str, Sequence[Sequence[float]]]]) -> Iterator[Row]:
    """Errors of all methods in the same windows; ours against patch-wise ICP with the better of its widths."""
    errors = {key: np.concatenate([np.reshape(case[key], (-1, 2)) for case in cases]) for key in cases[0]}
    rms = {key: 1000 * float(np.sqrt(np.nanmean(found**2))) for key, found in errors.items()}
    best = min(value for key, value in rms.items() if key.startswith(ICP))
    for key, found in errors.items():
        known = found[np.isfinite(found).all(axis=1)]
        far = 100 * float((np.hypot(*known.T) > MAX_CORE_ERROR_M).mean())
        mine = key == OURS
        yield Row(
            f"{name}, the same {len(found)} windows: rms error, {key}", f"{rms[key]:.1f} mm",
            f"≤ {MAX_RATIO_TO_ICP:g} x {ICP}" if mine else "",
            f"{rms[key] / best:.2f} x {ICP}; {far:.1f} % wrong by more than {MAX_CORE_ERROR_M:g} m",
            rms[key] <= MAX_RATIO_TO_ICP * best if mine else None,
        )  # fmt: skip
