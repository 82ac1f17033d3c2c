"""What a controller must know besides the networks: ``policy.json``, and ONNX metadata."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from lacoloco.datasets.artifact import Artifact
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation.rollout import ReachRecording
from lacoloco.pipelines.exporting.onnx_files import INPUTS
from lacoloco.pipelines.policies import Policy, task_of
from lacoloco.pipelines.sim.commands import COMMANDS, Command
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS
from lacoloco.pipelines.sim.observation import BY_ODOMETRY
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.robots.scene import FLOOR_FRICTION, TIMESTEP
from lacoloco.robots.spec import RobotSpec

FORMAT_VERSION = 3
MEANING = {
    "base_height": "Height of the base's origin above the floor. Needs an estimator or motion "
    "capture.",
    "projected_gravity": "Unit vector of gravity in the base frame, (0, 0, -1) when level: from "
    "the IMU.",
    "base_lin_vel": "Linear velocity of the base's origin in the base frame. Needs an estimator or "
    "motion capture.",
    "base_ang_vel": "Angular velocity of the base in the base frame: the gyroscope.",
    "joint_pos": "Joint angles as the model counts them, not relative to the default pose.",
    "joint_vel": "Joint speeds.",
    "last_action": "What the low level answered one control step ago, as it came; zeros at first.",
    "last_memory": "What the low level answered after the joints' actions one control step ago, as "
    "it came; zeros at first.",
    "velocity_command": "Forward and lateral velocity and yaw rate that are asked for, base frame.",
    "heading_command": "Unit vector of the heading that is asked for, rotated into the base frame.",
    "height_command": "Height above the floor at which the end effector is to be.",
    "target": "The point to touch, seen from the base: rotated into the base frame with the whole "
    "orientation, relative to the base's origin.",
    "last_latent": "What the high level answered at its last decision; zeros at first.",
}
"""Observation term -> one sentence."""
ODOMETRY = (
    "Position and heading come from the robot's own odometry, which was taken to drift in training."
)
"""Added to commands that are seen by odometry."""


def describe(
    policies: dict[str, Policy], spec: RobotSpec, artifact: Artifact, recorded: ReachRecording
) -> dict[str, Any]:
    """Everything a controller must know, as plain JSON data; SI units, joints in ``joint_names``
    order.

    Raises:
        StageError: The policy observes something that no sentence explains.
    """
    task = task_of(artifact, spec)
    return {
        "format": "lacoloco-policy",
        "format_version": FORMAT_VERSION,
        "robot": spec.name,
        "robot_model_sha256": spec.model_hash(),
        "method": artifact.metadata["method"],
        "artifact_sha256": artifact.content_hash,
        "lacoloco_version": artifact.lacoloco_version,
        "git_commit": artifact.git_commit,
        "joint_names": list(spec.joint_names),
        "joint_stiffness": list(spec.stiffness),
        "joint_damping": list(spec.damping),
        "effort_limits": spec.effort_limits().tolist(),
        "joint_ranges": _ranges(spec),
        "default_joint_pos": list(spec.default_joint_pos),
        "default_base_height": spec.default_height(),
        "action_scale": spec.action_scale,
        "action_rule": (
            "joint target = default_joint_pos + action_scale * action, held for control_dt; the "
            "low level's outputs after one action per joint are its memory"
        ),
        "torque_rule": (
            "joint_stiffness * (target - angle) - joint_damping * speed, within effort_limits"
        ),
        "fastest_joint_target": fastest_target(recorded, spec),
        "control_dt": CONTROL_DT,
        "decision_dt": CONTROL_DT * HOLD_STEPS,
        "latent_hold_steps": HOLD_STEPS,
        "latent_size": policies["high"].head.actions,
        "latent_rule": "a unit vector; the high level's network answers with one",
        "history_rule": (
            "a term with steps_ago is what it was so many control steps before; before the first "
            "step all was as in it"
        ),
        "quaternion_order": "wxyz",
        "end_effector": {
            "body": spec.end_effector.body,
            "offset_m": list(spec.end_effector.offset),
        },
        "command": _command(task.command),
        "trained_in": {
            "physics_step_s": TIMESTEP,
            "floor_friction": FLOOR_FRICTION,
            "start": "standing in the default pose, target drawn around the point below the base",
        },
        "levels": {role: _level(policy) for role, policy in policies.items()},
    }


def _ranges(spec: RobotSpec) -> list[list[float] | None]:
    """Lower and upper joint limit, None where there is none."""
    limited = spec.model().jnt_limited[1:].astype(bool)
    rows = np.stack(spec.joint_limits(), axis=1).tolist()
    return [row if known else None for row, known in zip(rows, limited, strict=True)]


def _command(command: Command | None) -> dict[str, Any] | None:
    """What was asked for in training, and the ranges that it was drawn from."""
    if command is None:
        return None
    kind = next(name for name, kind in COMMANDS.items() if isinstance(command, kind))
    ranges = {field.name: getattr(command, field.name) for field in fields(command)}  # type: ignore[arg-type]
    return {"type": kind, "observed_as": command.term.name, **ranges}


def _level(policy: Policy) -> dict[str, Any]:
    head = policy.head
    unknown = [row["name"] for row in head.layout if row["name"] not in MEANING]
    if unknown:
        raise StageError(f"no controller knows the observation {', '.join(map(repr, unknown))}")
    return {
        "inputs": {INPUTS[group]: size for group, size in head.sizes.items()},
        "output": "latent" if head.role == "high" else "action",
        "output_size": head.actions,
        "observation_terms": [{**row, "meaning": _meaning(row)} for row in head.layout],
    }


def _meaning(row: Mapping[str, Any]) -> str:
    """One or two sentences about a term."""
    told = MEANING[str(row["name"])]
    return f"{told} {ODOMETRY}" if row["frame"] == BY_ODOMETRY else told


def fastest_target(recorded: ReachRecording, spec: RobotSpec) -> float:
    """Fastest change of a joint target in simulated episodes [rad/s]."""
    steps = np.abs(np.diff(recorded.action, axis=1))
    change = steps.max() if steps.size else 0.0
    return float(spec.action_scale * change / CONTROL_DT)
