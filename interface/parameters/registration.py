"""Parameters of registration."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter

MAX_OFFSET_M = 50.0
"""The largest offset that a registration can be asked to find."""


@dataclass(frozen=True)
class RegistrationParameters(ParameterSet, record_name="registration"):
    """Registration of a later epoch (moving) to the first (reference)."""

    method: str = _parameter(
        "robust",
        "Registration method",
        "robust: point-to-plane with weights that keep real change from biasing it. icp: point-to-point as published. "
        "none: the epochs are taken as registered.",
        choices=("robust", "icp", "none"),
    )
    maximum_offset: float = _parameter(
        1.0,
        "Largest expected offset",
        "Search distance at the start of the robust registration. Larger finds larger offsets and takes longer.",
        unit="m",
        bounds=(0.01, MAX_OFFSET_M),
    )
    maximum_correspondence: float = _parameter(
        0.10,
        "Largest correspondence (icp)",
        "Pairs farther apart are ignored by the icp method. Larger finds larger offsets and is more biased by change.",
        unit="m",
        bounds=(0.001, 50.0),
        advanced=True,
    )
    registration_iterations: int = _parameter(
        200,
        "Iterations of the registration",
        "Upper limit; the registration stops earlier once the motion or the RMSE no longer changes.",
        bounds=(1, 10000),
        advanced=True,
    )
    registration_voxel: float = _parameter(
        0.1,
        "Voxel of the registration",
        "Points are averaged in cubes of this size first. Larger is faster, smaller keeps more detail.",
        unit="m",
        bounds=(0.01, 10.0),
        advanced=True,
    )
    minimum_stable_share: float = _parameter(
        0.3,
        "Minimum share of stable ground",
        "Below this share of stable ground the run warns, and the level of detection widens unless that ground is "
        "clearly the largest part that agrees on one motion.",
        bounds=(0.0, 1.0),
        advanced=True,
    )
    accept_unstable: bool = _parameter(
        False,
        "Accept a registration without stable ground",
        "Continues where less than the minimum share of the surface agrees and no part of it is clearly the one that "
        "did not move; the error is then as large as the differences. Off: such surveys are refused.",
        advanced=True,
    )
    piecewise: str = _parameter(
        "never",
        "Correct bent surveys",
        "Corrects heights where one rigid motion leaves stable ground bent over tens of metres, because strips do not "
        "fit or the survey is bowl-shaped. never: the run only reports it. auto: where the correction fits. always: "
        "everywhere. Slow movements of that extent are removed with it. Has no effect without the robust method.",
        choices=("never", "auto", "always"),
        advanced=True,
    )
    piece_size: float = _parameter(
        20.0,
        "Size of a piece",
        "Distance over which the correction of bent surveys may change. Smaller follows more and hides more movement.",
        unit="m",
        bounds=(5.0, 1000.0),
        advanced=True,
    )
