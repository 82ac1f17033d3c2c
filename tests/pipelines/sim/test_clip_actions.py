"""Actions inferred from states: the simulation itself is the oracle."""

from dataclasses import replace

import numpy as np
import torch

from lacoloco.datasets import rotations
from lacoloco.datasets.clip import Clip
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.sim.clip_actions import clip_states, infer_actions, previous_actions
from lacoloco.pipelines.sim.engines import make_physics
from lacoloco.pipelines.sim.physics import CONTROL_DT, PhysicsRequest
from lacoloco.pipelines.sim.state import RobotState

SCALE = 1.5


def performed(spec, steps=40):
    """A clip of a robot that bends its knees in a slow wave."""
    physics = make_physics(PhysicsRequest(spec, 1, threads=1))
    default = torch.tensor(spec.default_joint_pos)
    qpos = torch.zeros(1, 7 + spec.num_joints)
    qpos[:, 2], qpos[:, 3], qpos[:, 7:] = spec.default_height(), 1.0, default
    physics.reset(torch.arange(1), qpos, torch.zeros(1, 6 + spec.num_joints))
    states = []
    for step in range(steps):
        phase = torch.arange(spec.num_joints) + 0.2 * step
        action = 0.1 * torch.sin(phase)
        states.append((physics.qpos, RobotState.from_generalized(physics.qpos, physics.qvel)))
        physics.step((default + SCALE * action)[None])
    clip = Clip(
        "wave",
        1 / CONTROL_DT,
        spec.joint_names,
        *(
            np.concatenate([value.numpy() for value in column])
            for column in zip(
                *(
                    (q[:, :3], q[:, 3:7], s.lin_vel_b, s.ang_vel_b, s.joint_pos, s.joint_vel)
                    for q, s in states
                ),
                strict=True,
            )
        ),
    )
    return clip


def next_joint_pos(spec, clip, actions):
    """(T - 2, J) where the actions take the moments 1 to T - 2 of the clip."""
    moments = len(actions)
    physics = make_physics(PhysicsRequest(spec, moments, threads=1))
    qpos = torch.from_numpy(np.concatenate([clip.root_pos, clip.root_quat, clip.joint_pos], 1))
    linear = rotations.rotate(clip.root_quat, clip.root_lin_vel_b)
    qvel = torch.from_numpy(np.concatenate([linear, clip.root_ang_vel_b, clip.joint_vel], 1))
    physics.reset(torch.arange(moments), qpos[1:-1].float(), qvel[1:-1].float())
    physics.step(torch.tensor(spec.default_joint_pos) + SCALE * actions)
    return physics.qpos[:, 7:]


def infer(spec, *clips):
    return infer_actions(spec, clip_states(MotionLibrary(clips)), SCALE)


def test_inferred_actions_take_every_moment_to_the_next(solo12):
    clip = performed(solo12)
    actions = infer(solo12, clip)
    assert len(actions) == clip.frames
    assert not actions[-1].any()  # nothing comes after the last state
    chosen = actions[1:-1]
    wanted = torch.from_numpy(clip.joint_pos[2:])
    error = (next_joint_pos(solo12, clip, chosen) - wanted).abs().mean()
    idle = (next_joint_pos(solo12, clip, torch.zeros_like(chosen)) - wanted).abs().mean()
    assert error < 0.07 * idle
    assert error < 0.0005
    # Not the true ones: four feet on the ground may press against each other, and no motion tells.


def test_what_the_motors_were_asked_for_is_not_inferred(solo12):
    clip = performed(solo12, steps=12)
    asked = np.asarray(solo12.default_joint_pos) + SCALE * np.linspace(-2.0, 2.0, 12)[:, None]
    known = replace(clip, joint_target=asked.astype(np.float32))
    actions = infer(solo12, known, clip)
    assert torch.allclose(
        actions[:11], torch.linspace(-2.0, 2.0, 12)[:11, None].expand(11, 12), atol=1e-5
    )
    assert not actions[11].any()
    assert torch.equal(actions[12:], infer(solo12, clip)), "of the other one nobody knows"


def test_two_clips_are_never_taken_for_one(solo12):
    clip = performed(solo12, steps=12)
    one, two = infer(solo12, clip), infer(solo12, clip, clip)
    assert torch.allclose(two, torch.cat((one, one)), atol=1e-5)
    states = clip_states(MotionLibrary([clip, clip]))
    assert states.last.tolist() == [11] * 12 + [23] * 12
    assert torch.equal(previous_actions(states, two)[12], two[12])
    assert torch.equal(previous_actions(states, two)[13:], two[12:-1])


def test_states_at_the_control_rate_are_the_recorded_ones(solo12):
    clip = performed(solo12, steps=12)
    states = clip_states(MotionLibrary([clip]))
    assert torch.allclose(states.qpos[:, 7:], torch.from_numpy(clip.joint_pos), atol=1e-6)
    linear = rotations.rotate(clip.root_quat, clip.root_lin_vel_b)
    assert torch.allclose(states.qvel[:, :3], torch.from_numpy(linear).float(), atol=1e-5)
    ids = torch.zeros(3, dtype=torch.long)
    assert states.rows(ids, torch.tensor([0.0, 0.041, 9.0])).tolist() == [0, 2, 11]
