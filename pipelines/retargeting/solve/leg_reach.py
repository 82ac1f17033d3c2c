"""Feet put where they belong by their legs alone, the trunk held."""

from __future__ import annotations

import numpy as np

from lacoloco.pipelines.retargeting.solve.frame_functions import FrameFunctions
from lacoloco.pipelines.retargeting.solve.pose_problem import JOINTS
from lacoloco.pipelines.retargeting.targets.stretch import Stretch

MOST_TURNED = 0.4
"""rad by which a joint may turn per step while legs reach out."""
MENDINGS, MOST_MENDED = 3, 0.01
"""How often a joint may turn, and by how many rad, to put a foot where it belongs."""
EXACT = 1e-9
"""m by which a foot may be off where it belongs."""


def reach(
    functions: FrameFunctions,
    limits: tuple[np.ndarray, np.ndarray],
    joints: np.ndarray,
    base: np.ndarray,
    reference: np.ndarray,
    feet: np.ndarray,
    *,
    steps: int,
) -> np.ndarray:
    """Joints (T, J) of legs that reach for feet.

    Args:
        functions: Of one frame.
        limits: (J,) least and greatest joints.
        joints: (T, J) to begin with.
        base: (T, 6) position and turn.
        reference: (T, 4) quaternions that the turns are on top of.
        feet: (T, 3 F) m.
        steps: How many to take.
    """
    joints = np.clip(joints, *limits)
    for _ in range(steps):
        at = np.concatenate([base, joints], axis=1)
        (step,) = functions.leg_step(at, reference, feet)
        joints = np.clip(joints + np.clip(step, -MOST_TURNED, MOST_TURNED), *limits)
    return joints


def mend(functions: FrameFunctions, variables: np.ndarray, clip: Stretch) -> np.ndarray:
    """Put the feet exactly where they are planted, or onto their floor.

    A leg that is nearly straight, or a joint at its limit, may get further away; each frame keeps
    its best.

    Args:
        functions: Of one frame.
        variables: (T, n) found.
        clip: What was asked.

    Returns:
        Variables (T, n).
    """
    columns, reference = functions.feet, clip.parameters[:, :4]
    bounds = [bound[:, columns] for bound in clip.value_bounds]
    limits = [bound[:, JOINTS] for bound in clip.variable_bounds]
    best, least, tried = variables, np.full(len(variables), np.inf), variables
    for _ in range(MENDINGS + 1):
        (points,) = functions.coordinates(tried, clip.parameters)
        feet = points[:, functions.value_rows[columns]]
        wanted = np.clip(feet, *bounds)
        gap = np.abs(wanted - feet).max(axis=1)
        best = np.where((gap < least)[:, None], tried, best)
        least = np.minimum(gap, least)
        if least.max() < EXACT:
            break
        (step,) = functions.foot_step(tried, reference, wanted)
        tried = tried.copy()
        tried[:, JOINTS] += np.clip(step, -MOST_MENDED, MOST_MENDED)
        tried[:, JOINTS] = np.clip(tried[:, JOINTS], *limits)
    return best
