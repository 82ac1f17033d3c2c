"""Batched rotations as unit quaternions (w, x, y, z), for torch tensors and NumPy arrays alike.

Every function takes arrays of shape (..., 4) or (..., 3), broadcasts the leading dimensions and
gives back the kind and precision that it was given (both arguments of one kind). A quaternion named
`q` turns vectors of the body frame into the world frame: v_world = rotate(q, v_body). q and -q are
the same rotation; whatever compares or blends two of them takes the shorter arc.
Equations: J. Sola, "Quaternion kinematics for the error-state Kalman filter", 2017 (Hamilton).
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    import torch

    Array = TypeVar("Array", np.ndarray, torch.Tensor)

_TINY = 1e-12  # rad^2; below it the second-order series are exact in double precision


def _library(array: Array) -> ModuleType:
    """The module whose functions take `array`; torch is never imported for the sake of NumPy."""
    torch = sys.modules.get("torch")
    return torch if torch is not None and isinstance(array, torch.Tensor) else np


def _cross(a: Array, b: Array) -> Array:
    """Vector product (..., 3); torch.linalg.cross does not broadcast missing dimensions."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    parts = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
    return _library(a).stack(parts, axis=-1)


def normalize(q: Array) -> Array:
    """Quaternion (..., 4) scaled to unit length."""
    return q / (q * q).sum(-1)[..., None] ** 0.5


def conjugate(q: Array) -> Array:
    """Inverse rotation of a unit quaternion (..., 4)."""
    return _library(q).concatenate([q[..., :1], -q[..., 1:]], axis=-1)


def multiply(p: Array, q: Array) -> Array:
    """Hamilton product (..., 4): the rotation q followed by p in fixed axes (Sola eq. 12)."""
    pw, px, py, pz = p[..., 0], p[..., 1], p[..., 2], p[..., 3]
    qw, qx, qy, qz = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    return _library(p).stack(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        ],
        axis=-1,
    )


def rotate(q: Array, v: Array) -> Array:
    """Body vector v (..., 3) expressed in the world frame of the unit quaternion q (..., 4)."""
    u = q[..., 1:]
    twist = 2.0 * _cross(u, v)
    return v + q[..., :1] * twist + _cross(u, twist)


def rotate_inverse(q: Array, v: Array) -> Array:
    """World vector v (..., 3) expressed in the body frame of the unit quaternion q (..., 4)."""
    u = q[..., 1:]
    twist = 2.0 * _cross(u, v)
    return v - q[..., :1] * twist + _cross(u, twist)


def same_hemisphere(q: Array, reference: Array) -> Array:
    """Whichever of q and -q (..., 4) lies nearer to `reference` (..., 4)."""
    flip = (q * reference).sum(-1)[..., None] < 0
    return _library(q).where(flip, -q, q)


def continuous(q: Array) -> Array:
    """Series of quaternions (T, 4) with signs chosen so that neighbours lie in one hemisphere."""
    library = _library(q)
    sign = library.where((q[1:] * q[:-1]).sum(-1) < 0, -1.0, 1.0)
    sign = library.concatenate([library.ones_like(q[:1, 0]), sign]).cumprod(0)
    return q * library.asarray(sign, dtype=q.dtype)[:, None]


def exp_map(rotation_vector: Array) -> Array:
    """Unit quaternion (..., 4) of a rotation vector (..., 3), axis times angle in rad (eq. 101)."""
    library = _library(rotation_vector)
    squared = (rotation_vector * rotation_vector).sum(-1)[..., None]
    small = squared < _TINY
    angle = library.where(small, 1.0, squared) ** 0.5
    scale = library.where(small, 0.5 - squared / 48.0, library.sin(0.5 * angle) / angle)
    cosine = library.where(small, 1.0 - squared / 8.0, library.cos(0.5 * angle))
    return library.concatenate([cosine, scale * rotation_vector], axis=-1)


def log_map(q: Array) -> Array:
    """Rotation vector (..., 3) in rad of a unit quaternion (..., 4), shortest arc (eq. 105)."""
    library = _library(q)
    q = library.where(q[..., :1] < 0, -q, q)
    w, u = q[..., :1], q[..., 1:]
    squared = (u * u).sum(-1)[..., None]
    small = squared < _TINY
    sine = library.where(small, 1.0, squared) ** 0.5
    scale = library.where(small, 2.0 + squared / 3.0, 2.0 * library.arctan2(sine, w) / sine)
    return scale * u


def slerp(start: Array, end: Array, fraction: Array) -> Array:
    """Constant-speed blend of unit quaternions (..., 4) along the shorter arc.

    Args:
        start: quaternion at fraction 0.
        end: quaternion at fraction 1; its sign does not matter.
        fraction: (...,) without the last dimension of the quaternions, in [0, 1].

    Returns:
        Unit quaternions (..., 4), in the hemisphere of `start`.
    """
    library = _library(start)
    end = same_hemisphere(end, start)
    # The angle from the chord, not from arccos of the dot product, which loses half of the digits.
    chord = ((end - start) ** 2).sum(-1) ** 0.5
    angle = 2.0 * library.arcsin(library.clip(0.5 * chord, 0.0, 1.0))
    small = angle < 1e-4  # the linear blend is then exact to 1e-9 and free of 0/0
    sine = library.sin(library.where(small, 1.0, angle))
    a = library.where(small, 1.0 - fraction, library.sin((1.0 - fraction) * angle) / sine)
    b = library.where(small, fraction, library.sin(fraction * angle) / sine)
    return normalize(a[..., None] * start + b[..., None] * end)


def angular_velocity_b(start: Array, end: Array, dt: float) -> Array:
    """Constant angular velocity (..., 3) in the body frame, rad/s, that turns start into end.

    Args:
        start: unit quaternion (..., 4) now.
        end: unit quaternion (..., 4) after `dt`; its sign does not matter.
        dt: seconds between the two; turns beyond half a revolution alias, as they must.
    """
    return log_map(multiply(conjugate(start), end)) / dt


def yaw(q: Array) -> Array:
    """Heading (...,) in rad: angle about world z of the body x axis, seen from above."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    return _library(q).arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def from_yaw(angle: Array) -> Array:
    """Quaternion (..., 4) of a turn by `angle` (...,) rad about world z."""
    library = _library(angle)
    zero = library.zeros_like(angle)
    return library.stack([library.cos(angle / 2), zero, zero, library.sin(angle / 2)], axis=-1)


def from_euler(angles: Array, order: str) -> Array:
    """Quaternion (..., 4) of intrinsic Euler angles (..., n) in rad.

    Args:
        angles: one angle per letter of `order`.
        order: axes in the order applied, each about the axis already turned: "zxy" = Rz Rx Ry.
    """
    result = None
    for index, axis in enumerate(order.lower()):
        half = 0.5 * angles[..., index]
        library = _library(half)
        parts = [library.cos(half)] + 3 * [library.zeros_like(half)]
        parts[1 + "xyz".index(axis)] = library.sin(half)
        turn = library.stack(parts, axis=-1)
        result = turn if result is None else multiply(result, turn)
    if result is None:
        raise ValueError("order names no axis")
    return result


def to_matrix(q: Array) -> Array:
    """Rotation matrix (..., 3, 3), columns = body axes in the world frame (eq. 115)."""
    library = _library(q)
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return library.stack([library.stack(row, axis=-1) for row in rows], axis=-2)


def from_matrix(matrix: Array) -> Array:
    """Unit quaternion (..., 4), w >= 0, of a rotation matrix (..., 3, 3).

    The 4x4 matrix 4 q q^T is linear in the rotation matrix; its row with the largest diagonal
    entry is a multiple of q far from zero (Bar-Itzhack 2000), so no case loses digits.
    """
    library = _library(matrix)
    m = [[matrix[..., i, j] for j in range(3)] for i in range(3)]
    w, x, y = m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]
    xy, xz, yz = m[0][1] + m[1][0], m[0][2] + m[2][0], m[1][2] + m[2][1]
    rows = [
        [1 + m[0][0] + m[1][1] + m[2][2], w, x, y],
        [w, 1 + m[0][0] - m[1][1] - m[2][2], xy, xz],
        [x, xy, 1 - m[0][0] + m[1][1] - m[2][2], yz],
        [y, xz, yz, 1 - m[0][0] - m[1][1] + m[2][2]],
    ]
    outer = library.stack([library.stack(row, axis=-1) for row in rows], axis=-2)
    diagonal = library.stack([rows[i][i] for i in range(4)], axis=-1)
    best = diagonal.argmax(-1)[..., None, None]
    if library is np:
        q = np.take_along_axis(outer, best, axis=-2)[..., 0, :]
    else:
        q = library.take_along_dim(outer, best, dim=-2)[..., 0, :]
    q = normalize(q)
    return library.where(q[..., :1] < 0, -q, q)
