"""Layouts and frames of observations, against numbers worked out by hand."""

import math

import pytest
import torch

from lacoloco.pipelines.sim.state import (
    RobotState,
    Term,
    high_level_terms,
    layout,
    noise_scale,
    policy_terms,
    style_frame,
    style_terms,
    width,
)
from lacoloco.robots.registry import load_robot

HALF = math.sqrt(0.5)


@pytest.mark.parametrize(
    ("joints", "style", "policy", "high"), [(12, 34, 46, 44), (19, 48, 67, 58)]
)
def test_widths_are_those_of_the_paper(joints, style, policy, high):
    assert width(style_terms(joints)) == style
    assert width(policy_terms(joints)) == policy
    assert width(high_level_terms(joints, 7)) == high


def test_slices_of_a_layout_are_contiguous_and_in_the_order_of_the_design():
    rows = layout(policy_terms(12, command=Term("target", 3, "m", "base")))
    assert [(row["name"], row["slice"]) for row in rows] == [
        ("base_height", [0, 1]),
        ("projected_gravity", [1, 4]),
        ("base_lin_vel", [4, 7]),
        ("base_ang_vel", [7, 10]),
        ("joint_pos", [10, 22]),
        ("joint_vel", [22, 34]),
        ("last_action", [34, 46]),
        ("target", [46, 49]),
    ]
    assert all(row["unit"] and row["frame"] for row in rows)
    names = [row["name"] for row in layout(high_level_terms(12, 7))]
    assert names[-2:] == ["target", "last_latent"]
    assert "last_action" not in names


def test_noise_follows_the_terms():
    scale = noise_scale(policy_terms(2, load_robot("solo12").observation_noise))
    expected = [0.005] + [0.05] * 3 + [0.1] * 3 + [0.2] * 3 + [0.05] * 2 + [1.5] * 2 + [0.0] * 2
    assert torch.allclose(scale, torch.tensor(expected))


def test_frame_equals_hand_built_numbers():
    """A robot on its left side (rolled by +90 degrees), heading along x, moving up and along x.

    Its y axis then points up and its z axis along -y: gravity is -y of the base, a world velocity
    (1, 2, 3) is (1, 3, -2) in the base.
    """
    quat = [HALF, HALF, 0.0, 0.0]
    qpos = torch.tensor([[7.0, 8.0, 0.3, *quat, 0.1, -0.2]])
    qvel = torch.tensor([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.7, 0.8]])
    expected = [0.3, 0.0, -1.0, 0.0, 1.0, 3.0, -2.0, 4.0, 5.0, 6.0, 0.1, -0.2, 0.7, 0.8]
    frame = style_frame(RobotState.from_generalized(qpos, qvel))
    assert torch.allclose(frame, torch.tensor([expected]), atol=1e-6)


def test_frame_does_not_depend_on_where_the_robot_is_and_heads():
    generator = torch.Generator().manual_seed(0)
    qpos = torch.randn(1, 9, generator=generator)
    qpos[:, 3:7] = torch.nn.functional.normalize(qpos[:, 3:7], dim=-1)
    qvel = torch.randn(1, 8, generator=generator)
    moved_pos, moved_vel = qpos.clone(), qvel.clone()
    moved_pos[:, :2] += 5.0
    w, x, y, z = qpos[0, 3:7]
    moved_pos[0, 3:7] = HALF * torch.stack(
        [w - z, x - y, y + x, z + w]
    )  # turned left by 90 degrees
    moved_vel[0, :2] = torch.stack([-qvel[0, 1], qvel[0, 0]])
    here = style_frame(RobotState.from_generalized(qpos, qvel))
    there = style_frame(RobotState.from_generalized(moved_pos, moved_vel))
    assert torch.allclose(here, there, atol=1e-5)


def test_demonstrations_and_agent_go_through_the_same_frame(motions):
    """A clip's state put into generalised coordinates gives the same columns: bug B5."""
    frames = motions.frames(torch.tensor([0, 1]), torch.tensor([0.31, 0.77]))
    demonstration = RobotState.from_motion(frames)
    yaw = 2 * torch.atan2(frames.root_quat[:, 3], frames.root_quat[:, 0])
    forward = frames.root_lin_vel_b
    world = torch.stack(
        [
            torch.cos(yaw) * forward[:, 0] - torch.sin(yaw) * forward[:, 1],
            torch.sin(yaw) * forward[:, 0] + torch.cos(yaw) * forward[:, 1],
            forward[:, 2],
        ],
        dim=-1,
    )
    qpos = torch.cat([frames.root_pos, frames.root_quat, frames.joint_pos], dim=-1)
    qvel = torch.cat([world, frames.root_ang_vel_b, frames.joint_vel], dim=-1)
    agent = RobotState.from_generalized(qpos, qvel)
    assert torch.allclose(style_frame(demonstration), style_frame(agent), atol=1e-5)
    assert torch.allclose(forward[:, 0], torch.tensor(0.4), atol=1e-3)
