"""Which forces on the standing feet carry a motion: the smallest ones within their friction cones.

    min_f  |A f - w|^2 + small |f|^2     s.t.  every force within the pyramid of its friction cone

Solved for all frames at once by accelerated projected gradients (Beck and Teboulle, "A fast
iterative shrinkage-thresholding algorithm", 2009) over weights >= 0 of the pyramids' edges.
"""

from __future__ import annotations

import numpy as np

FRICTION = 0.8
"""Of rubber on a floor."""
EDGES = FRICTION * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]) + [0.0, 0.0, 1.0]
"""(4, 3) edges of the pyramid of one foot."""
LEAST = 1e-4
"""Weight of the forces' own size, relative to the largest curvature: what spreads them evenly."""
ROUNDS = 400


def distribute(maps: np.ndarray, wrench: np.ndarray, stands: np.ndarray) -> np.ndarray:
    """Forces of the ground on the feet.

    Args:
        maps: (T, 6, F, 3) what a force on each foot adds to the wrench of the base.
        wrench: (T, 6) that the ground must give; force and torque in comparable units.
        stands: (T, F) bool, which feet may push.

    Returns:
        (T, F, 3) forces, in the units of the wrench over those of the maps.
    """
    frames, _, feet, _ = maps.shape
    edges = np.einsum("twfi,ei->twfe", maps, EDGES) * stands[:, None, :, None]
    edges = edges.reshape(frames, 6, -1)
    square = np.swapaxes(edges, 1, 2) @ edges
    steep = np.maximum(np.trace(square, axis1=1, axis2=2), 1e-9)[:, None]
    linear = (np.swapaxes(edges, 1, 2) @ wrench[..., None])[..., 0]
    # A foot in the air has no edges, and its weights stay at 0.
    weights = ahead = np.zeros_like(linear)
    momentum = 1.0
    for _ in range(ROUNDS):
        slope = (square @ ahead[..., None])[..., 0] - linear + LEAST * steep * ahead
        new = np.maximum(ahead - slope / steep, 0.0)
        grown = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        ahead = new + (momentum - 1) / grown * (new - weights)
        weights, momentum = new, grown
    return weights.reshape(frames, feet, len(EDGES)) @ EDGES
