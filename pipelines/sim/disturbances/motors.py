"""Motors as they are: late targets, gains and encoders that are off, torque that falls with speed.

They are computed before every physics step.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch

from lacoloco.pipelines.sim.disturbances.config import Disturbances
from lacoloco.pipelines.sim.disturbances.randomness import grades, own_generator, rounded, spread
from lacoloco.robots.spec import RobotSpec

CORNER = 0.5
"""Share of the speed limit up to which a motor has its full torque."""
LONG_AGO = np.iinfo(np.int64).min


class Motors:
    """The motors of N worlds with J joints each.

    Attributes:
        offset: (N, J) errors of the encoders [rad]: what they read less what is.
    """

    def __init__(
        self, config: Disturbances, spec: RobotSpec, model: mujoco.MjModel, worlds: int, seed: int
    ) -> None:
        """Draw gains and encoder errors of every world."""
        self._config, self._dt = config, float(model.opt.timestep)
        self._generator = own_generator(seed, 1)
        shape = (worlds, len(spec.joint_names))
        factor = 1.0 + spread(config.gain_error, (2, *shape), self._generator).double().numpy()
        self._kp, self._kd = (
            np.array(spec.stiffness) * factor[0],
            np.array(spec.damping) * factor[1],
        )
        self.offset = spread(config.joint_offset, shape, self._generator).double().numpy()
        self._latency = config.action_latency * grades(config.graded, worlds, self._generator)
        self._losses = grades(config.graded, worlds, self._generator).double().numpy()
        self._limit = model.actuator_forcerange[:, 1].copy()
        self._top_speed = np.array(spec.velocity_limits)
        longest = config.action_latency * (1.0 + config.latency_jitter) + self._dt
        kept = 2 + math.ceil(longest / (self._dt * config.substeps))
        self._targets = np.zeros((kept, *shape))
        self._arrival = np.full((kept, worlds), LONG_AGO)
        self._clock = 0

    def restart(self, rows: np.ndarray, joint_pos: np.ndarray) -> None:
        """In ``rows`` (K,) hold the pose (K, J) [rad] until a target arrives."""
        self._targets[:, rows], self._arrival[:, rows] = joint_pos + self.offset[rows], LONG_AGO

    def command(self, targets: np.ndarray) -> None:
        """Send joint targets (N, J) [rad], at the beginning of a control step."""
        jitter = spread(self._config.latency_jitter, (len(targets),), self._generator)
        delay = self._latency * (1.0 + jitter)
        self._targets = np.concatenate((self._targets[1:], targets[None]))
        arrival = self._clock + rounded(delay / self._dt, self._generator).numpy()
        self._arrival = np.concatenate((self._arrival[1:], arrival[None]))

    def control(self, joint_pos: np.ndarray, joint_vel: np.ndarray) -> np.ndarray:
        """(N, J) controls of the next physics step: targets in the true joint angles [rad], or
        torques [N.m] of an explicit controller.
        """
        target = self._targets[0]
        for sent, arrival in zip(self._targets[1:], self._arrival[1:], strict=True):
            target = np.where((arrival <= self._clock)[:, None], sent, target)
        self._clock += 1
        target = target - self.offset
        if not self._config.explicit_pd:
            return target
        return self._kp * (target - joint_pos) - self._kd * joint_vel

    def install(self, batch: Batch, spec: RobotSpec) -> None:
        """Give the batch what is every world's own: the joints' friction and damping, and gains,
        which an explicit controller's motors have not.
        """
        if self._config.graded:  # the model has all of it: take away what a world has not
            missing = 1.0 - self._losses[:, None]
            friction = missing * self._config.joint_friction * spec.effort_limits()
            batch.expand("dof_frictionloss")[:, 6:] -= friction
            damping = batch.expand("dof_damping").reshape(len(missing), 6 + len(spec.damping), -1)
            damping[:, 6:, 0] -= missing * self._config.joint_damping * np.array(spec.damping)
        if self._config.explicit_pd or self._config.gain_error == 0.0:
            return
        batch.expand("actuator_gainprm")[:, :, 0] = self._kp
        bias = batch.expand("actuator_biasprm")
        bias[:, :, 1], bias[:, :, 2] = -self._kp, -self._kd

    def limit_torque(self, batch: Batch, joint_vel: np.ndarray) -> None:
        """Set the torque that is left at these speeds (N, J) [rad/s]; braking has it all."""
        if not self._config.torque_speed:
            return
        left = (1.0 - np.abs(joint_vel) / self._top_speed) / (1.0 - CORNER)
        left = self._limit * np.clip(left, 0.0, 1.0)
        ranges = batch.expand("actuator_forcerange")
        ranges[..., 0] = -np.where(joint_vel < 0.0, left, self._limit)
        ranges[..., 1] = np.where(joint_vel > 0.0, left, self._limit)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Targets on their way, and the generator."""
        return {
            "motor_targets": torch.from_numpy(self._targets.copy()),
            "motor_arrival": torch.from_numpy(self._arrival.copy()),
            "motor_clock": torch.tensor(self._clock),
            "motor_generator": self._generator.get_state(),
        }

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state_dict`."""
        self._targets = state["motor_targets"].numpy().copy()
        self._arrival = state["motor_arrival"].numpy().copy()
        self._clock = int(state["motor_clock"])
        self._generator.set_state(state["motor_generator"])
