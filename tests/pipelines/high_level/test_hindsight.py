"""Hindsight: what latents led to becomes what they are for."""

import pytest
import torch

from lacoloco.datasets.rotations import from_yaw, rotate
from lacoloco.pipelines.high_level.hindsight import (
    HindsightConfig,
    RelabellingBuffer,
    _fresh,
    _segment_end,
    clone_hindsight,
    relabel,
)
from lacoloco.pipelines.learn.networks import NetworkConfig, make_actor
from lacoloco.pipelines.sim.commands import TargetCommand
from lacoloco.robots.numbers import HindsightDistances

DISTANCES = HindsightDistances(stride=0.15, farthest=2.0)
COMMAND = TargetCommand(radius=1.5, z=(0.16, 0.42))
WALK = (0.2, 0.1, 0.0)
CONFIG = HindsightConfig(steps=300, batch=256)


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def memory(moves, worlds=64, steps=6, base=(0.0, 0.0, 0.0)):
    """Worlds that turn left by one radian a world, begin at their own place and move their foot by
    ``moves`` (3,) a decision, as seen from there, and themselves by ``base`` (3,).
    """
    yaw = torch.arange(worlds).float()
    quat = from_yaw(yaw).expand(steps, worlds, 4)
    place = torch.stack((yaw, -yaw, torch.full((worlds,), 0.25)), dim=-1).expand(steps, worlds, 3)
    decisions = torch.arange(steps).float()[:, None, None]

    def after(move):
        along = (decisions * torch.tensor(move)).expand(steps, worlds, 3)
        return place + rotate(quat.reshape(-1, 4), along.reshape(-1, 3)).view(steps, worlds, 3)

    return RelabellingBuffer(
        obs=torch.zeros(steps, worlds, 10),
        latent=torch.nn.functional.normalize(
            torch.randn(steps, worlds, 7, generator=generator()), dim=-1
        ),
        end_effector=after(moves),
        root_pos=after(base),
        root_quat=quat,
        segment_end=torch.full((steps, worlds), steps - 1),
        segment_starts=torch.arange(3 * worlds),
    )


def test_a_latent_ends_with_its_hold_or_its_episode():
    ends = torch.tensor([[0, 1, 0, 0, 1, 0, 0]], dtype=torch.bool).T
    assert _segment_end(ends).flatten().tolist() == [1, 1, 4, 4, 4, 6, 6]
    assert _fresh(ends).flatten().tolist() == [True] * 7
    longer = torch.zeros(9, 1, dtype=torch.bool)
    longer[3] = True
    assert _fresh(longer).flatten().tolist() == [True] * 3 + [False] + [True] * 3 + [False] * 2


def test_where_the_foot_was_lifted_to_is_the_target():
    """Straight up by 6 cm a decision: too low to be a target at first, and no step."""
    target, rows, weight = relabel(memory((0.0, 0.0, 0.06)), COMMAND, DISTANCES, 2000, generator())
    assert torch.allclose(target[:, :2], torch.zeros(2000, 2), atol=1e-5), "base frame"
    height = (target[:, 2] / 0.06).round()
    assert torch.allclose(target[:, 2], 0.06 * height, atol=1e-5)
    when = rows // 64
    assert ((height > when) & (height <= 5)).all(), "later, and within the hold"
    assert torch.equal(weight > 0.0, target[:, 2] + 0.25 > COMMAND.z[0])


def test_a_latent_that_walks_serves_all_targets_in_its_direction():
    target, _, weight = relabel(memory(WALK, base=WALK), COMMAND, DISTANCES, 4000, generator())
    away = target[:, :2]
    distance = away.norm(dim=-1)
    assert torch.allclose(away[:, 1] / away[:, 0], torch.full((4000,), 0.5), atol=1e-4)
    assert float(distance.min()) >= 0.2236 - 1e-4
    assert float(distance.max()) == pytest.approx(2.0, abs=0.02)
    world_height = target[:, 2] + 0.25
    assert COMMAND.z[0] <= float(world_height.min()) < 0.2
    assert 0.38 < float(world_height.max()) <= COMMAND.z[1]
    assert torch.allclose(weight, torch.ones(4000), atol=1e-4), "all are as fast"


def test_what_leads_nowhere_serves_nothing():
    assert not relabel(
        memory((0.0, 0.0, 0.0)), TargetCommand(z=(0.3, 0.4)), DISTANCES, 100, generator()
    )[2].any()
    ended = memory(WALK, base=WALK)
    ended = RelabellingBuffer(
        **{**vars(ended), "segment_end": torch.arange(6)[:, None].expand(6, 64)}
    )
    assert not relabel(ended, COMMAND, DISTANCES, 100, generator())[2].any(), (
        "no later decision under the same latent"
    )


def test_a_policy_learns_which_latent_leads_where():
    """Latents whose first two numbers are the direction in which the foot goes."""
    worlds, steps = 256, 4
    angle = torch.rand(worlds, generator=generator(1)) * 2 * torch.pi
    direction = torch.stack((angle.cos(), angle.sin(), torch.zeros(worlds)), dim=-1)
    base = memory((0.0, 0.0, 0.0), worlds, steps)
    upright = torch.tensor([1.0, 0.0, 0.0, 0.0]).expand(steps, worlds, 4)
    latent = torch.nn.functional.pad(direction[:, :2], (0, 5)).expand(steps, worlds, 7)
    end_effector = base.root_pos + 0.3 * torch.arange(steps)[:, None, None] * direction
    moving = RelabellingBuffer(
        **{
            **vars(base),
            "end_effector": end_effector,
            "root_pos": end_effector,
            "latent": latent,
            "root_quat": upright,
            "obs": torch.zeros(steps, worlds, 44),
        }
    )
    torch.manual_seed(0)
    actor = make_actor({"policy": 44}, 7, NetworkConfig(actor=(64, 64)))
    columns = {"target": slice(34, 37), "last_latent": slice(37, 44)}
    assert clone_hindsight(actor, moving, COMMAND, columns, DISTANCES, CONFIG, generator()) > 0.95


def test_a_task_with_farther_targets_has_them_served():
    far = TargetCommand(x=(0.3, 3.0), y=(-4.0, 1.0), z=(0.16, 0.42))
    assert far.farthest() == pytest.approx(5.0)
    target = relabel(memory(WALK, base=WALK), far, DISTANCES, 4000, generator())[0]
    assert float(target[:, :2].norm(dim=-1).max()) == pytest.approx(5.0, abs=0.05)


def test_an_arm_that_goes_far_has_not_walked():
    """A humanoid's hand comes forward by more than a stride while it is lifted."""
    target, rows, weight = relabel(memory((0.1, 0.0, 0.06)), COMMAND, DISTANCES, 2000, generator())
    ahead, up = target[:, 0] / 0.1, target[:, 2] / 0.06
    assert torch.allclose(ahead, up, atol=1e-4), "the point that the hand came to"
    assert float(target[:, 0].max()) > 2 * DISTANCES.stride
    assert torch.equal(weight > 0.0, target[:, 2] + 0.25 > COMMAND.z[0])
