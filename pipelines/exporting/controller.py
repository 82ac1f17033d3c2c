"""Runs a policy that `lacoloco export` wrote: sensors and a goal in, motor commands out.

Copy this folder to the robot. It needs Python 3.11, NumPy and onnxruntime, and the files beside it.

    controller = Controller("path/of/this/folder")
    while True:  # 50 times a second
        command = controller.step(read_sensors(), goal, now)
        send(command.position, command.stiffness, command.damping)

SI units. Joints are in the order of ``controller.policy["joint_names"]``. A motor is to make the
torque stiffness x (position - its angle) - damping x its speed, within ``effort_limits``.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime

Array = np.ndarray
OWN = ("last_action", "last_memory", "last_latent")
"""Terms that the controller remembers itself."""


@dataclass(frozen=True)
class Sensors:
    """What the robot measures.

    Attributes:
        time: when, on the clock of ``now`` [s].
        joint_pos: (J,) [rad].
        joint_vel: (J,) [rad/s].
        base_quat: (4,) rotation from base to world, w x y z.
        base_ang_vel: (3,) in the base frame [rad/s].
        base_pos: (3,) of the base in the world, z above the floor [m]. A policy that observes
            neither height nor velocity only needs an odometry: where the base has come to in the
            frame of the goal, as ``base_quat`` has its heading. None: not measured.
        base_lin_vel: (3,) in the base frame [m/s]. Needs an estimator. None: not measured.
    """

    time: float
    joint_pos: Array
    joint_vel: Array
    base_quat: Array
    base_ang_vel: Array
    base_pos: Array | None = None
    base_lin_vel: Array | None = None

    def finite(self) -> bool:
        """Whether every number is one."""
        measured = [value for value in vars(self).values() if value is not None]
        return all(bool(np.isfinite(value).all()) for value in measured)


@dataclass(frozen=True)
class Command:
    """What the motors are to do.

    Attributes:
        position: (J,) joint targets [rad].
        stiffness: (J,) [N.m/rad].
        damping: (J,) [N.m.s/rad].
        mode: ``rise``, ``stand``, ``run`` or ``stop``.
    """

    position: Array
    stiffness: Array
    damping: Array
    mode: str


@dataclass(frozen=True)
class Safety:
    """Limits of the controller, not of the policy.

    Attributes:
        rise_s: while the gains rise from zero, the joints hold where they are [s]. For a robot
            that lies or hangs; 0 for one that stands.
        stand_s: how long they then take to the standing pose [s].
        stale_s: sensors older than this stop the robot [s].
        tilt: so does a base that is tilted by more [rad].
        slew: fastest change of a joint target [rad/s]; None: what the policy needed in simulation,
            and half of it more.
    """

    rise_s: float = 1.0
    stand_s: float = 2.0
    stale_s: float = 0.1
    tilt: float = 1.0
    slew: float | None = None


class Controller:
    """Stands up, then runs the policy; stops for good when something is wrong.

    Attributes:
        policy: the description, ``policy.json``.
        mode: ``rise``, ``stand``, ``run`` or ``stop``.
        reason: why it stopped, "" while it has not.
    """

    def __init__(self, folder: str | Path, safety: Safety | None = None) -> None:
        """Read the files of ``folder``.

        Raises:
            ValueError: they do not belong together.
        """
        folder = Path(folder)
        self.policy: dict[str, Any] = json.loads((folder / "policy.json").read_text())
        check(folder, self.policy)
        self._networks = {
            level: onnxruntime.InferenceSession(
                str(folder / f"{level}.onnx"), providers=["CPUExecutionProvider"]
            )
            for level in ("low", "high")
        }
        self._terms: dict[str, list[dict[str, Any]]] = {
            level: described["observation_terms"]
            for level, described in self.policy["levels"].items()
        }
        every = [term for terms in self._terms.values() for term in terms]
        self._oldest = max(term.get("steps_ago", 0) for term in every)
        self._needed = {term["name"] for term in every} - set(OWN)
        self._safety = safety or Safety()
        self._default, self._stiffness, self._damping = (
            np.array(self.policy[key], dtype=np.float32)
            for key in ("default_joint_pos", "joint_stiffness", "joint_damping")
        )
        ranges = [row or (-np.inf, np.inf) for row in self.policy["joint_ranges"]]
        self._lower, self._upper = np.array(ranges, dtype=np.float32).T
        slew = self._safety.slew
        if slew is None:
            slew = 1.5 * self.policy["fastest_joint_target"]
        self._most = slew * self.policy["control_dt"]
        self.mode, self.reason = "rise", ""
        self._began: float | None = None
        self._first = self._position = self._default
        self.reset()

    def reset(self) -> None:
        """Forget all actions, latents and readings, as at the start of an episode."""
        self._steps = 0
        self._readings: list[Mapping[str, Array]] = []
        self._answer = np.zeros(self.policy["levels"]["low"]["output_size"], dtype=np.float32)
        self._latent = np.zeros(self.policy["latent_size"], dtype=np.float32)

    def step(self, sensors: Sensors, goal: Array, now: float) -> Command:
        """One control step, ``control_dt`` after the last.

        Args:
            sensors: what the robot measures.
            goal: (3,) what the task asks for, see ``command`` in the description: a point in the
                world that the end effector is to touch [m], or a velocity [m/s, m/s, rad/s], ...
            now: the time [s].
        """
        goal = np.asarray(goal, dtype=np.float64)
        if self._began is None:
            self._began, self._first, self._position = now, sensors.joint_pos, sensors.joint_pos
        self.reason = self.reason or self._fault(sensors, goal, now)
        if self.reason:
            self.mode = "stop"
            return Command(sensors.joint_pos, 0.0 * self._stiffness, self._damping, self.mode)
        gain, wanted = self._wanted(sensors, goal, now - self._began)
        # A slew limit for accidents: the policy itself stays below it.
        change = np.clip(wanted - self._position, -self._most, self._most)
        self._position = np.clip(self._position + change, self._lower, self._upper)
        return Command(self._position, gain * self._stiffness, self._damping, self.mode)

    def _wanted(self, sensors: Sensors, goal: Array, since: float) -> tuple[float, Array]:
        """Share of the gains, and joint targets (J,) [rad], ``since`` the start [s]."""
        rise, stand = self._safety.rise_s, self._safety.stand_s
        if since < rise:
            self.mode = "rise"
            return since / rise, self._first
        if since < rise + stand:
            self.mode = "stand"
            share = (since - rise) / stand
            return 1.0, (1.0 - share) * self._first + share * self._default
        self.mode = "run"
        return 1.0, self._act(sensors, goal)

    def _act(self, sensors: Sensors, goal: Array) -> Array:
        """(J,) joint targets of the policy [rad]."""
        values = observe(sensors, goal) | {
            "last_action": self._answer[: len(self._default)],
            "last_memory": self._answer[len(self._default) :],
            "last_latent": self._latent,
        }
        self._readings = [values, *self._readings[: self._oldest]]
        if self._steps % self.policy["latent_hold_steps"] == 0:
            self._latent = self._infer("high")
        self._steps += 1
        self._answer = self._infer("low")
        action = self._answer[: len(self._default)]
        target_pos: Array = self._default + self.policy["action_scale"] * action
        return target_pos

    def _infer(self, level: str) -> Array:
        observation = np.concatenate([np.ravel(self._read(term)) for term in self._terms[level]])
        inputs = {"observation": observation[None].astype(np.float32)}
        if level == "low":
            inputs["latent"] = self._latent[None]
        output: Array = self._networks[level].run(None, inputs)[0][0]
        return output

    def _read(self, term: Mapping[str, Any]) -> Array:
        """A term as it was ``steps_ago``; before the first step all was as in it."""
        age = min(term.get("steps_ago", 0), len(self._readings) - 1)
        return self._readings[age][term["name"]]

    def _fault(self, sensors: Sensors, goal: Array, now: float) -> str:
        """Why the robot has to stop, "" if nothing is wrong."""
        if not sensors.finite() or not np.isfinite(goal).all():
            return "a sensor or the goal is not a number"
        if now - sensors.time > self._safety.stale_s:
            return f"sensors are {now - sensors.time:.3f} s old"
        measured = observe(sensors, goal)
        if missing := self._needed - measured.keys():
            return f"the policy observes what is not measured: {', '.join(sorted(missing))}"
        if -measured["projected_gravity"][2] < np.cos(self._safety.tilt):
            return "the base is tilted too far"
        return ""


def observe(sensors: Sensors, goal: Array) -> dict[str, Array]:
    """Observation term -> value, of all that is measured; see ``observation_terms`` in
    ``policy.json``.
    """
    inverse = rotation(sensors.base_quat).T
    values = {
        "projected_gravity": inverse @ np.array([0.0, 0.0, -1.0]),
        "base_ang_vel": sensors.base_ang_vel,
        "joint_pos": sensors.joint_pos,
        "joint_vel": sensors.joint_vel,
        "heading_command": inverse @ goal,
        "velocity_command": goal,
        "height_command": goal[2:],
    }
    if sensors.base_pos is not None:
        values["base_height"] = sensors.base_pos[2:3]
        values["target"] = inverse @ (goal - sensors.base_pos)
    if sensors.base_lin_vel is not None:
        values["base_lin_vel"] = sensors.base_lin_vel
    return values


def rotation(quat: Array) -> Array:
    """(3, 3) matrix of a quaternion w x y z of any length but zero."""
    w, x, y, z = quat / np.linalg.norm(quat)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def check(folder: Path, policy: Mapping[str, Any]) -> None:
    """Compare the files with the hashes in the description.

    Raises:
        ValueError: one is missing or another one.
    """
    for name, expected in policy["sha256"].items():
        path = folder / name
        if not path.is_file():
            raise ValueError(f"{path}: missing; copy the whole folder that was exported")
        if hashlib.sha256(path.read_bytes()).hexdigest() != expected:
            raise ValueError(f"{path}: not the file that was exported with policy.json")
