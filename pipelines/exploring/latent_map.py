"""A map of the latent sphere: what held latents do, and a plane to show them in.

A low level's artifact keeps no latents of its clips, only the policy. So the map is made of latents
drawn uniformly and held from a standing start, as for the skill coverage.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from lacoloco.pipelines.evaluation.skill_cells import FORWARD, LATERAL, LIFT, YAW, SkillCells
from lacoloco.pipelines.evaluation.skill_coverage import hold, standing_env
from lacoloco.pipelines.learn.latents import sample_latents
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.stage import SILENT, Progress
from lacoloco.robots.spec import RobotSpec

SECONDS = 3.0
"""s for which each latent is held, of which the second half is watched."""
EXTREMES = (
    ("fastest forward", FORWARD, 1, "m/s"),
    ("fastest backward", FORWARD, -1, "m/s"),
    ("fastest to the left", LATERAL, 1, "m/s"),
    ("fastest to the right", LATERAL, -1, "m/s"),
    ("turns left most", YAW, 1, "rad/s"),
    ("turns right most", YAW, -1, "rad/s"),
    ("reaches highest", LIFT, 1, "m"),
)
"""What is looked for among held latents: name, axis of the motion, direction, unit."""


@dataclass(frozen=True)
class HeldLatents:
    """What N latents do.

    Attributes:
        latents: (N, d) unit vectors.
        motion: (N, 4) mean forward and lateral velocity [m/s], yaw rate [rad/s], and lift of the
            end effector above its height in standing [m].
        speed: (N,) mean planar speed [m/s].
        fell: (N,) bool.
        shares: Shares that walk, reach, stand and fall.
        poses: (N, 7 + J) where each ends: position [m], quaternion wxyz, joints [rad].
    """

    latents: np.ndarray
    motion: np.ndarray
    speed: np.ndarray
    fell: np.ndarray
    shares: dict[str, float]
    poses: np.ndarray


@dataclass(frozen=True)
class Extreme:
    """The held latent that does one thing most.

    Attributes:
        name: What it does.
        index: Its number.
        value: How much.
        unit: Of the value.
    """

    name: str
    index: int
    value: float
    unit: str


def hold_sampled(
    spec: RobotSpec, low: Policy, count: int, seed: int, progress: Progress = SILENT
) -> HeldLatents:
    """Draw ``count`` latents from ``seed`` and hold them, all at once."""
    device = torch.device("cpu")
    env = standing_env(spec, count, seed, device, low.head.observation)
    generator = torch.Generator().manual_seed(seed)
    latents = sample_latents(count, low.head.sizes["latent"], generator)
    done = hold(env, low, latents, round(SECONDS / CONTROL_DT), progress)
    return HeldLatents(
        latents.double().numpy(),
        done.motion.double().numpy(),
        done.speed.double().numpy(),
        done.fell.numpy(),
        done.shares(),
        env.physics.qpos.double().numpy().copy(),
    )


def extremes(held: HeldLatents, cells: SkillCells) -> list[Extreme]:
    """Who does what most, of those that did not fall; what does not count as walking, turning or
    reaching for the robot is left out.
    """
    upright = np.flatnonzero(~held.fell)
    least = (cells.walk_speed, cells.walk_speed, cells.turn_speed, cells.reach_height)
    found = []
    for name, axis, sign, unit in EXTREMES:
        values = sign * held.motion[upright, axis]
        if len(values) and values.max() > least[axis]:
            index = int(upright[values.argmax()])
            found.append(Extreme(name, index, float(held.motion[index, axis]), unit))
    if len(upright):
        still = int(upright[np.abs(held.motion[upright] / np.array(least)).max(axis=1).argmin()])
        found.append(Extreme("stands stillest", still, float(held.speed[still]), "m/s"))
    return found


class LatentMap:
    """A disc on which the latents lie: their parts along two directions of the latent space.

    The two are those along which the motion covaries most with the latents (partial least squares):
    what lies apart on the map moves differently.

    Attributes:
        axes: (d, 2) orthonormal.
        points: (N, 2) where the held latents lie, inside the unit disc.
    """

    def __init__(self, held: HeldLatents) -> None:
        """Choose the directions."""
        upright = ~held.fell if (~held.fell).sum() > 1 else np.ones_like(held.fell)
        motion, latents = held.motion[upright], held.latents[upright]
        scaled = (motion - motion.mean(axis=0)) / np.maximum(motion.std(axis=0), 1e-6)
        left, _, _ = np.linalg.svd((latents - latents.mean(axis=0)).T @ scaled)
        self.axes: np.ndarray = left[:, :2]
        self._latents = held.latents
        self.points = self.place(held.latents)

    def place(self, latents: np.ndarray) -> np.ndarray:
        """(..., d) unit latents -> (..., 2) points of the disc."""
        placed: np.ndarray = latents @ self.axes
        return placed

    def latent_at(self, point: np.ndarray, now: np.ndarray) -> np.ndarray:
        """The unit latent (d,) nearest to ``now`` (d,) that lies at a point (2,) of the disc; one
        outside is brought to its edge.
        """
        point = point / max(1.0, float(np.linalg.norm(point)))
        rest = now - self.axes @ self.place(now)
        length = float(np.linalg.norm(rest))
        if length < 1e-6:  # on the edge all others are as near
            rest = np.linalg.svd(self.axes)[0][:, -1] if len(now) > 2 else np.zeros_like(now)
            length = 1.0
        left = np.sqrt(max(0.0, 1.0 - float(point @ point)))
        found: np.ndarray = self.axes @ point + left * rest / length
        return found / np.linalg.norm(found)

    def nearest(self, point: np.ndarray, within: float) -> int | None:
        """The held latent whose point is nearest to a point (2,); None if none is so near."""
        distance = np.linalg.norm(self.points - point, axis=1)
        index = int(distance.argmin())
        return index if distance[index] <= within else None
