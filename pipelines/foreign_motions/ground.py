"""Where the ground of a motion is, and which feet stand on it: from kinematics and heights."""

from __future__ import annotations

import numpy as np

from lacoloco.pipelines.sim.body_states import BodyStates, body_states
from lacoloco.robots.spec import RobotSpec

_GROUND_QUANTILE = 0.1
"""Of the lowest foot's height over the frames: the feet stand most of the time."""
_HEIGHT_SHARE = 0.05
"""Of the standing height: how far above the ground a foot still counts as down (Solo12 1.2 cm)."""
_SPEED_SHARE = 0.15
"""Of sqrt(g h), the speed of a fall from the standing height h: below it a foot stands."""
_SHORTEST_S = 0.06
"""Contacts and flights that are shorter belong to what is around them."""


def ground_height(spec: RobotSpec, bodies: BodyStates) -> float:
    """Height of the ground that the feet stand on, m."""
    lowest = (foot_heights(spec, bodies)).min(axis=1)
    return float(np.quantile(lowest, _GROUND_QUANTILE))


def foot_heights(spec: RobotSpec, bodies: BodyStates) -> np.ndarray:
    """(T, F) height of each foot's lowest point as it is when the robot stands, m."""
    origins = bodies.pos[:, [bodies.names.index(foot) for foot in spec.feet], 2]
    return origins - _standing_heights(spec)


def foot_contacts(spec: RobotSpec, bodies: BodyStates, fps: float) -> np.ndarray:
    """(T, F) bool, which feet stand on the ground at height 0: near it, and slow."""
    height = spec.default_height()
    gravity = float(np.linalg.norm(spec.model().opt.gravity))
    feet = bodies.pos[:, [bodies.names.index(foot) for foot in spec.feet]]
    speed = np.linalg.norm(np.gradient(feet, 1.0 / fps, axis=0), axis=2)
    near = foot_heights(spec, bodies) < _HEIGHT_SHARE * height
    down = near & (speed < _SPEED_SHARE * np.sqrt(gravity * height))
    shortest = max(1, round(_SHORTEST_S * fps))
    return np.column_stack([_steady(column, shortest) for column in down.T])


def _standing_heights(spec: RobotSpec) -> np.ndarray:
    """(F,) height of the origins of the feet in the default pose, on the ground."""
    qpos = spec.default_qpos()[None]
    standing = body_states(spec, qpos[:, :3], qpos[:, 3:7], qpos[:, 7:])
    return standing.pos[0, [standing.names.index(foot) for foot in spec.feet], 2]


def _steady(down: np.ndarray, shortest: int) -> np.ndarray:
    """(T,) bool without flights, then without contacts, of fewer frames than `shortest`."""
    for state in (False, True):
        edges = np.flatnonzero(np.diff(down.astype(int))) + 1
        spans = zip([0, *edges.tolist()], [*edges.tolist(), len(down)], strict=True)
        down = down.copy()
        for start, stop in spans:
            inside = start > 0 and stop < len(down)
            if inside and stop - start < shortest and down[start] == state:
                down[start:stop] = not state
    return down
