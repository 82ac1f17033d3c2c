import math

import torch

from lacoloco.pipelines.sim.commands import (
    HeadingCommand,
    TargetCommand,
    VelocityCommand,
    uniform,
)
from lacoloco.pipelines.sim.state import RobotState


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def state(root_pos, quat):
    zero = torch.zeros(1, 3)
    return RobotState(torch.tensor([root_pos]), torch.tensor([quat]), zero, zero, zero, zero)


def test_uniform_fills_each_column_with_its_range():
    drawn = uniform(((-1.0, 1.0), (5.0, 7.0), (3.0, 3.0)), 4000, generator())
    assert drawn.shape == (4000, 3)
    assert torch.allclose(drawn.amin(0), torch.tensor([-1.0, 5.0, 3.0]), atol=0.01)
    assert torch.allclose(drawn.amax(0), torch.tensor([1.0, 7.0, 3.0]), atol=0.01)
    assert torch.allclose(drawn.mean(0), torch.tensor([0.0, 6.0, 3.0]), atol=0.05)


def test_velocity_commands_stay_in_range_and_some_worlds_stand():
    command = VelocityCommand((-0.5, 0.5), (-0.2, 0.1), (-0.78, 0.78), standing=0.25)
    drawn = command.sample(torch.zeros(4000, 3), generator())
    standing = (drawn == 0).all(dim=-1).float().mean()
    assert 0.2 < standing < 0.3
    assert drawn[:, 1].min() >= -0.2
    assert drawn[:, 1].max() <= 0.1


def test_box_targets_lie_around_the_origin():
    command = TargetCommand(x=(0.3, 0.4), y=(-0.1, 0.1), z=(0.2, 0.5))
    origin = torch.tensor([[10.0, 20.0, 99.0]]).repeat(500, 1)
    drawn = command.sample(origin, generator())
    assert (drawn.amin(0) >= torch.tensor([10.3, 19.9, 0.2]) - 1e-5).all()
    # The height is above the ground, wherever the origin's is.
    assert (drawn.amax(0) <= torch.tensor([10.4, 20.1, 0.5]) + 1e-5).all()


def test_cylinder_targets_lie_on_its_shell_all_around():
    drawn = TargetCommand(radius=1.5, z=(0.16, 0.42)).sample(torch.zeros(2000, 3), generator())
    assert torch.allclose(drawn[:, :2].norm(dim=-1), torch.tensor(1.5), atol=1e-5)
    angle = torch.atan2(drawn[:, 1], drawn[:, 0])
    quarters = torch.histc(angle, 4, -math.pi, math.pi)
    assert (quarters > 400).all()


def test_a_share_of_the_targets_is_pulled_in():
    command = TargetCommand(radius=1.5, z=(0.16, 0.42), near=0.25)
    drawn = command.sample(torch.zeros(4000, 3), generator())
    distance = drawn[:, :2].norm(dim=-1)
    near = distance < 1.5 - 1e-4
    assert 0.22 < near.float().mean() < 0.28
    # Uniform factors: as many in each quarter of the way, and the height is left alone.
    assert (torch.histc(distance[near], 4, 0.0, 1.5) > 0.2 * near.sum()).all()
    assert drawn[near, 2].min() < 0.18 and drawn[near, 2].max() > 0.40


def test_targets_are_seen_in_the_base_frame():
    """Turned left by 90 degrees, what lies ahead in the world lies to the right (-y) of the
    base.
    """
    command = TargetCommand(z=(0.0, 0.0))
    half = math.sqrt(0.5)
    seen = command.observe(
        torch.tensor([[3.0, 2.0, 0.5]]), state([1.0, 2.0, 0.3], [half, 0, 0, half])
    )
    assert torch.allclose(seen, torch.tensor([[0.0, -2.0, 0.2]]), atol=1e-6)


def test_targets_tilt_with_the_base():
    """Nose down by 90 degrees about y: a point below the base is ahead of it."""
    command = TargetCommand(z=(0.0, 0.0))
    half = math.sqrt(0.5)
    seen = command.observe(
        torch.tensor([[0.0, 0.0, -1.0]]), state([0.0, 0.0, 0.0], [half, 0, half, 0])
    )
    assert torch.allclose(seen, torch.tensor([[1.0, 0.0, 0.0]]), atol=1e-6)


def test_equal_seeds_draw_equal_commands():
    command = TargetCommand(radius=1.0, z=(0.0, 1.0))
    first, second, third = (
        command.sample(torch.zeros(5, 3), generator(seed)) for seed in (3, 3, 4)
    )
    assert torch.equal(first, second)
    assert not torch.equal(first, third)


def test_a_command_is_carried_to_where_another_robot_stands():
    """A quarter turn to the left and 2 m on: what was ahead lies to the left, heights stay."""
    half = math.sqrt(0.5)
    pose = torch.tensor([[1.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0]])
    other = torch.tensor([[3.0, 0.0, 0.5, half, 0.0, 0.0, half]])
    target = TargetCommand(z=(0.0, 1.0)).carried(torch.tensor([[1.5, 0.1, 0.4]]), pose, other)
    assert torch.allclose(target, torch.tensor([[2.9, 0.5, 0.4]]), atol=1e-6)
    heading = HeadingCommand().carried(torch.tensor([[1.0, 0.0, 0.0]]), pose, other)
    assert torch.allclose(heading, torch.tensor([[0.0, 1.0, 0.0]]), atol=1e-6)
    velocity = torch.tensor([[0.4, 0.0, 0.2]])
    stands = VelocityCommand((0.0, 1.0), (0.0, 0.0), (0.0, 0.0))
    assert torch.equal(stands.carried(velocity, pose, other), velocity)
