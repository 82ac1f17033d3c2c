"""Plays an exported folder in plain MuJoCo at 1 kHz, as a stranger to lacoloco would.

    python play_in_mujoco.py FOLDER EPISODES SEED

Prints one JSON object: the error of the end effector at the end of each episode [m], and how many
robots were stopped by the controller.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import mujoco
import numpy as np

PHYSICS_DT, SECONDS = 0.001, 10.0


class Robot:
    """One robot in simulation, with motors and perfect sensors."""

    def __init__(self, folder: Path, policy: dict) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(folder / "robot.xml"))
        self.model.opt.timestep = PHYSICS_DT
        self.data, self.policy = mujoco.MjData(self.model), policy
        self.motors = [self.model.actuator(name).id for name in policy["joint_names"]]
        joints = [self.model.joint(name) for name in policy["joint_names"]]
        self.qpos = [int(joint.qposadr[0]) for joint in joints]
        self.qvel = [int(joint.dofadr[0]) for joint in joints]
        self.body = self.model.body(policy["end_effector"]["body"]).id
        self.data.qpos[2] = policy["default_base_height"]
        self.data.qpos[self.qpos] = policy["default_joint_pos"]
        mujoco.mj_forward(self.model, self.data)

    def sense(self, kind):
        quat, base_lin_vel = self.data.qpos[3:7].copy(), np.zeros(3)
        inverse = np.zeros(4)
        mujoco.mju_negQuat(inverse, quat)
        mujoco.mju_rotVecQuat(base_lin_vel, self.data.qvel[:3].copy(), inverse)
        return kind(
            time=self.data.time,
            joint_pos=self.data.qpos[self.qpos].copy(),
            joint_vel=self.data.qvel[self.qvel].copy(),
            base_quat=quat,
            base_ang_vel=self.data.qvel[3:6].copy(),
            base_pos=self.data.qpos[:3].copy(),
            base_lin_vel=base_lin_vel,
        )

    def obey(self, command) -> None:
        """Hold one command for a control step."""
        model, motors = self.model, self.motors
        model.actuator_gainprm[motors, 0] = command.stiffness
        model.actuator_biasprm[motors, 1] = -command.stiffness
        model.actuator_biasprm[motors, 2] = -command.damping
        self.data.ctrl[motors] = command.position
        for _ in range(round(self.policy["control_dt"] / PHYSICS_DT)):
            mujoco.mj_step(model, self.data)

    def end_effector(self) -> np.ndarray:
        matrix = self.data.xmat[self.body].reshape(3, 3)
        return self.data.xpos[self.body] + matrix @ self.policy["end_effector"]["offset_m"]


def draw(command: dict, random: np.random.Generator) -> np.ndarray:
    """A target as in training: in a box, or on an upright cylinder."""
    x, y, z = (random.uniform(*command[axis]) for axis in "xyz")
    if command["radius"] is not None:
        angle = random.uniform(-np.pi, np.pi)
        x, y = command["radius"] * np.cos(angle), command["radius"] * np.sin(angle)
    return np.array([x, y, z])


def episode(folder: Path, seed: int, module) -> tuple[float, str]:
    """Error at the end [m], and why the controller stopped."""
    safety = module.Safety(rise_s=0.0, stand_s=0.5)  # the robot stands already
    controller = module.Controller(folder, safety)
    robot = Robot(folder, controller.policy)
    target = draw(controller.policy["command"], np.random.default_rng(seed))
    steps = (safety.rise_s + safety.stand_s + SECONDS) / controller.policy["control_dt"]
    for _ in range(round(steps)):
        robot.obey(controller.step(robot.sense(module.Sensors), target, robot.data.time))
    return float(np.linalg.norm(robot.end_effector() - target)), controller.reason


def main() -> None:
    folder, episodes, seed = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    sys.modules["lacoloco"] = None  # an import of it fails
    sys.path.insert(0, str(folder))
    import controller

    played = [episode(folder, seed + number, controller) for number in range(episodes)]
    stopped = [reason for _, reason in played if reason]
    sys.stdout.write(json.dumps({"errors": [error for error, _ in played], "stopped": stopped}))


if __name__ == "__main__":
    main()
