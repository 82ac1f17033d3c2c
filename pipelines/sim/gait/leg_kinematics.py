"""Legs as two segments in a plane: joint angles for an ankle that is to be somewhere below the hip,
with the sole as level as in the default pose. Everything is read from the MJCF.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
import torch

from lacoloco.robots.errors import RobotError
from lacoloco.robots.spec import RobotSpec

STRAIGHT = 0.994
"""Share of the straight leg's length that the ankle is kept within."""
PARALLEL = 0.999


@dataclass(frozen=True)
class Leg:
    """One leg in the plane of its pitch joints; angles lean forward from straight down [rad].

    Attributes:
        pitch: Columns of the joints of hip, knee and ankle.
        yaw: Column of the joint that turns the leg, None without one.
        signs: +1 or -1 per pitch joint: whether it turns about +y.
        yaw_sign: The same about +z.
        lengths: Of thigh and shank [m].
        leans: Of thigh and shank with all joints at 0.
        side: y of the foot in the base frame, default pose [m].
        default: Default angles of the pitch joints [rad].
    """

    pitch: tuple[int, int, int]
    yaw: int | None
    signs: tuple[float, float, float]
    yaw_sign: float
    lengths: tuple[float, float]
    leans: tuple[float, float]
    side: float
    default: tuple[float, float, float]

    def ankle(self) -> tuple[float, float]:
        """Where the ankle is in the default pose: forward of the hip and below it [m]."""
        turned = np.cumsum([s * q for s, q in zip(self.signs, self.default, strict=True)])
        lean = [a - t for a, t in zip(self.leans, turned, strict=False)]
        forward = sum(length * math.sin(a) for length, a in zip(self.lengths, lean, strict=True))
        below = sum(length * math.cos(a) for length, a in zip(self.lengths, lean, strict=True))
        return forward, below

    def solve(self, forward: torch.Tensor, below: torch.Tensor) -> torch.Tensor:
        """(N,) ankle forward of the hip and below it [m] -> (N, 3) angles of the pitch joints.

        The knee bends the way that it bends in the default pose; an ankle that is out of reach is
        brought nearer.
        """
        thigh, shank = self.lengths
        distance = torch.sqrt(forward.square() + below.square())
        distance = distance.clamp(abs(thigh - shank) + 1e-6, STRAIGHT * (thigh + shank))
        cosine = (distance.square() - thigh**2 - shank**2) / (2.0 * thigh * shank)
        bend = self._bends() * torch.acos(cosine.clamp(-1.0, 1.0))
        lean = torch.atan2(forward, below)
        upper = lean + torch.atan2(shank * torch.sin(bend), thigh + shank * torch.cos(bend))
        # Turned about +y so far, from the base down to each segment.
        hip, knee = self.leans[0] - upper, self.leans[1] - (upper - bend)
        level = sum(s * q for s, q in zip(self.signs, self.default, strict=True))
        turns = (hip, knee - hip, level - knee)
        return torch.stack([s * t for s, t in zip(self.signs, turns, strict=True)], dim=-1)

    def _bends(self) -> float:
        """+1 where the knee is in front of the line from hip to ankle, -1 behind."""
        between = self.leans[0] - self.leans[1] + self.signs[1] * self.default[1]
        return math.copysign(1.0, between)


def find_legs(spec: RobotSpec) -> tuple[Leg, ...]:
    """The legs of a robot, one per foot, in the order of its feet.

    Raises:
        RobotError: A leg has not exactly three joints about y: hip, knee and ankle.
    """
    model = spec.model()
    data = mujoco.MjData(model)
    data.qpos[3:7] = (1.0, 0.0, 0.0, 0.0)
    data.qpos[:3] = data.qpos[7:] = 0.0
    mujoco.mj_kinematics(model, data)
    standing = mujoco.MjData(model)
    standing.qpos[:] = spec.default_qpos()
    mujoco.mj_kinematics(model, standing)
    return tuple(_leg(spec, model, data, float(standing.body(f).xpos[1]), f) for f in spec.feet)


def _leg(
    spec: RobotSpec, model: mujoco.MjModel, data: mujoco.MjData, side: float, foot: str
) -> Leg:
    chain = _joints_to(model, foot)
    pitch = [j for j in chain if abs(data.xaxis[j][1]) > PARALLEL]
    if len(pitch) != 3:
        raise RobotError(
            f"robot {spec.name!r}: the leg of {foot!r} has {len(pitch)} joints about y; a gait "
            "needs three: hip, knee and ankle"
        )
    turning = [j for j in chain if abs(data.xaxis[j][2]) > PARALLEL]
    hip, knee, ankle = (data.xanchor[j] for j in pitch)
    segments = [(b - a)[[0, 2]] for a, b in ((hip, knee), (knee, ankle))]
    thigh, shank = (float(np.linalg.norm(s)) for s in segments)
    first, second = (math.atan2(s[0], -s[1]) for s in segments)
    columns = [j - 1 for j in pitch]
    return Leg(
        pitch=(columns[0], columns[1], columns[2]),
        yaw=turning[0] - 1 if turning else None,
        signs=tuple(float(np.sign(data.xaxis[j][1])) for j in pitch),
        yaw_sign=float(np.sign(data.xaxis[turning[0]][2])) if turning else 1.0,
        lengths=(thigh, shank),
        leans=(first, second),
        side=side,
        default=tuple(spec.default_joint_pos[c] for c in columns),
    )


def _joints_to(model: mujoco.MjModel, body: str) -> list[int]:
    """Numbers of the joints from the base to a body, the base's own left out."""
    joints: list[int] = []
    current = model.body(body).id
    while model.body_parentid[current] != 0:
        first, count = int(model.body_jntadr[current]), int(model.body_jntnum[current])
        joints = [*range(first, first + count), *joints]
        current = int(model.body_parentid[current])
    return joints
