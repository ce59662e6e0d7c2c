"""Thinnest directions of many small point sets at once, in closed form."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float


def thinnest(xx: Float, yy: Float, zz: Float, xy: Float, xz: Float, yz: Float) -> tuple[Float, Float, Float]:
    """Smallest and middle eigenvalue and the eigenvector of the smallest one of symmetric matrices (3, 3).

    Smith 1961 (doi:10.1145/355578.366316): the roots of the characteristic polynomial by the cosine of a third of an
    angle. The vector is the longest product of two rows of the matrix less that root. Where both smaller roots are the
    same, as on a line, any direction across is as good; without any spread it is upwards.

    Args:
        xx, yy, zz, xy, xz, yz: (n,) elements.

    Returns:
        (n,) smallest and (n,) middle eigenvalue, not below zero, and (n, 3) unit vectors.
    """
    mean = (xx + yy + zz) / 3
    a, b, c = xx - mean, yy - mean, zz - mean
    spread = np.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    cosine = np.clip(determinant / np.maximum(2 * spread**3, np.finfo(float).tiny), -1.0, 1.0)
    angle = np.arccos(cosine) / 3
    largest = 2 * spread * np.cos(angle)
    smallest = 2 * spread * np.cos(angle + 2 * np.pi / 3)
    a, b, c = a - smallest, b - smallest, c - smallest
    products = np.stack(
        [
            [xy * yz - xz * b, xz * xy - a * yz, a * b - xy * xy],
            [xy * c - xz * yz, xz * xz - a * c, a * yz - xy * xz],
            [b * c - yz * yz, yz * xz - xy * c, xy * yz - b * xz],
        ]
    )  # rows 0 x 1, 0 x 2, 1 x 2; their components; points
    longest = np.argmax(np.einsum("rin,rin->rn", products, products), axis=0)
    vector = products[longest, :, np.arange(len(mean))]
    length = np.sqrt(np.einsum("ni,ni->n", vector, vector))
    none = length <= np.finfo(float).tiny
    vector[none], length[none] = [0.0, 0.0, 1.0], 1.0
    middle = np.maximum(mean - largest - smallest, 0.0)
    return np.maximum(mean + smallest, 0.0), middle, vector / length[:, None]
