"""How a robot stands when its motors do nothing but hold its default pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lacoloco.robots.scene import compile_scene

if TYPE_CHECKING:
    import mujoco

    from lacoloco.robots.spec import RobotSpec

SECONDS = 10.0
FALL_FORCE = 1.0
"""N on a body that is not to touch the floor."""
LOOKS_PER_SECOND = 50.0


@dataclass(frozen=True)
class Stance:
    """What became of a robot that was put into its default pose and told to hold it.

    Attributes:
        seconds: For how long it was watched; until it fell, if it did.
        fell: What fell: a body of ``fall_bodies`` that touched the floor, ``TILT`` or ``DIVERGED``;
            "" if it stood to the end.
        height: Of its base over the floor in the default pose, m.
        sag: By how much the base is lower at the end, as a share of that height.
        tilt: Of the base at the end, rad.
        effort: Largest torque at the end as a share of the motor's.
        qpos: (7 + J,) at the end.
    """

    seconds: float
    fell: str
    height: float
    sag: float
    tilt: float
    effort: float
    qpos: np.ndarray

    @property
    def said(self) -> str:
        """One line."""
        if self.fell:
            how = HOW.get(self.fell, f"{self.fell} touches the floor")
            return f"falls within {self.seconds:.1f} s under its gains: {how}"
        return (
            f"stands for {self.seconds:.0f} s under its gains, sags by {100 * self.sag:.1f} % of"
            " its height"
        )


TILT, DIVERGED = "tilt", "diverged"
HOW = {TILT: "it tips over", DIVERGED: "the physics diverges"}


def stand(spec: RobotSpec, seconds: float = SECONDS) -> Stance:
    """Simulate a robot that holds its default pose.

    It begins at rest, its feet just touching the floor. It has fallen when one of its
    ``fall_bodies`` touches something or when its base tilts by more than ``training_tilt``.

    Raises:
        RobotError: Its MJCF lacks a body or joint that it names.
    """
    import mujoco

    model = compile_scene(spec)
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = spec.default_qpos(), spec.default_joint_pos
    steps = max(1, round(1.0 / (LOOKS_PER_SECOND * model.opt.timestep)))
    fell, looked = "", 0.0
    while looked < seconds and not fell:
        for _ in range(steps):
            mujoco.mj_step(model, data)
        # what diverges is put back to the start by MuJoCo, time included
        fell = DIVERGED if data.time <= looked else _fallen(spec, data)
        looked += steps * model.opt.timestep
    height = spec.default_height()
    limits = spec.effort_limits()
    share = np.abs(data.actuator_force) / np.where(limits > 0.0, limits, np.inf)
    return Stance(
        seconds=looked,
        fell=fell,
        height=height,
        sag=float(1.0 - data.qpos[2] / height),
        tilt=_tilt(data),
        effort=float(share.max()),
        qpos=data.qpos.copy(),
    )


def _fallen(spec: RobotSpec, data: mujoco.MjData) -> str:
    for body in spec.fall_bodies:
        if np.linalg.norm(data.sensor(f"force_{body}").data) > FALL_FORCE:
            return body
    # not "larger": a world that diverged has no tilt
    return "" if _tilt(data) <= spec.terminations.training_tilt else TILT


def _tilt(data: mujoco.MjData) -> float:
    return float(np.arccos(np.clip(data.xmat[1, 8], -1.0, 1.0)))
