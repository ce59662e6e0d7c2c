"""Registration of the series of planes, boxes and bowls of which more and more move."""

from __future__ import annotations

import time

import numpy as np

from ...engine.core.errors import InputError
from ...engine.registration.register import register
from ...interface.parameters import RegistrationParameters
from ...simulation.surveys.moving_pieces import EPOCHS, first_epoch, moved_epoch, shares_moved
from .registration import rms_mm
from .table import Row, say

CASES = ((1, False), (2, False), (1, True), (2, True))  # seed, and whether neighbours move together
RIGHT = 1.0  # mm
WANTED = 17  # of 19 epochs


def rows() -> list[Row]:
    """Errors on what has not moved, and the errors stated, where pieces go their own ways and where blocks do."""
    return [_row(seed, together) for seed, together in CASES]


def _row(seed: int, together: bool) -> Row:
    reference = first_epoch(seed)
    errors, ratios, refused, seconds = [], [], [], []
    for share in shares_moved():
        epoch = moved_epoch(seed, share, together=together)
        started = time.process_time()
        try:
            found = register(reference, epoch.xyz, RegistrationParameters())
        except InputError as refusal:
            refused.append(epoch.share)
            say(f"{epoch.share:.2f} moved: refused ({refusal})")
            continue
        finally:
            seconds.append(time.process_time() - started)
        still = epoch.xyz[epoch.stable]
        away = found.transform.apply(still) - epoch.transform.apply(still)
        errors.append(rms_mm(away))
        assert found.covariance is not None
        spread = found.covariance[3:, 3:].trace()
        middle = found.transform.apply(still).mean(axis=0) - epoch.transform.apply(still).mean(axis=0)
        ratios.append(float(np.linalg.norm(middle) / np.sqrt(spread)))
        say(f"{epoch.share:.2f} moved: {errors[-1]:.2f} mm")
    right = int(np.sum(np.array(errors) <= RIGHT))
    kind = "as blocks" if together else "each its own way"
    wrong = len(errors) - right
    return Row(
        f"planes, boxes and bowls, 0 to 96 % moved {kind}, seed {seed}: epochs within {RIGHT:g} mm",
        f"{right} of {EPOCHS}, {len(refused)} refused"
        + (f" (from {min(refused):.0%} moved)" if refused else "")
        + f", {wrong} wrong (largest {max(errors, default=0.0):.2f} mm); {np.mean(seconds):.1f} s CPU",
        f"at least {WANTED}, none wrong",
        f"distance by which it errs over the standard error stated: median {np.median(ratios):.2f}, "
        f"largest {max(ratios):.1f}",
        bool(right >= WANTED and not wrong),
    )
