"""Copies of clouds in another frame, without their points in memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from laspy import PackedPointRecord

from ...interface.parameters import InputParameters
from ..geometry.columns import greatest, least
from ..geometry.rigid_transform import RigidTransform
from .in_parts import CloudFile
from .reading import open_cloud
from .records import coordinates
from .writing import Target, copy_records, scales_and_offsets, set_coordinates


def copy_moved(source: Path, output: Path, transform: RigidTransform, inputs: InputParameters | None = None) -> None:
    """Copy a cloud with every dimension it has, each point moved; the file is that of ``writing.copy_with``.

    Raises:
        InputError: as ``writing.copies``.
    """
    header, frame = open_cloud(source, inputs)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for part in CloudFile(source, frame.crs, inputs, transform).parts():
        low, high = np.minimum(low, least(part.xyz)), np.maximum(high, greatest(part.xyz))
    scales, offsets = scales_and_offsets(output, np.stack([low, high]), np.array(header.scales) * frame.factors)

    def change(records: PackedPointRecord, part: slice) -> None:
        xyz = transform.apply(coordinates(records, header, frame.factors))
        set_coordinates(records.array, xyz, scales, offsets)

    copy_records(header, [Target(output, frame.crs, scales, offsets, change)])
