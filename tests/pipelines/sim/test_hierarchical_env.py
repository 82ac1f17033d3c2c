"""One decision of the high level: five control steps under one latent."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch

from lacoloco.pipelines.sim.env import LeggedEnv, Step
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS, LatentSteeredEnv
from lacoloco.pipelines.sim.state import layout
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.robots.numbers import ObservationNoise

LIMIT = 25.0


class ScriptedEnv:
    """Stands in for a `LeggedEnv` of two worlds: pays 1 per step, falls and times out on cue."""

    def __init__(self, falls=(), time_outs=()):
        self.num_worlds, self.num_actions, self.device = 2, 12, torch.device("cpu")
        self.task = SimpleNamespace(command=None, has_target=True)
        noise = ObservationNoise()
        self.spec = SimpleNamespace(
            foot_force_limit=lambda: LIMIT, feet=("a", "b"), observation_noise=noise, num_joints=12
        )
        self.physics = SimpleNamespace(foot_force=torch.zeros(2, 4, 2))
        self.falls, self.time_outs, self.count, self.resets = falls, time_outs, 0, []

    def observe(self):
        return torch.full((2, 49), float(self.count))

    def step(self, action):
        self.count += 1
        self.physics.foot_force = torch.zeros(2, 4, 2)
        self.physics.foot_force[:, 1:3, 0] = LIMIT + 1.0
        fell, timed_out = torch.zeros(2, dtype=torch.bool), torch.zeros(2, dtype=torch.bool)
        fell[0], timed_out[0] = self.count in self.falls, self.count in self.time_outs
        return Step(torch.zeros(2, 34), torch.ones(2), fell, timed_out, ~fell, {})

    def target_error(self):
        return torch.tensor([1.0, 2.0]) / self.count

    def reset(self, mask):
        self.resets.append(mask)


def steered(env, seen=None):
    def low(obs, z):
        if seen is not None:
            seen.append((obs, z))
        return torch.zeros(len(obs), env.num_actions)

    return LatentSteeredEnv(env, low, 7)


def test_one_latent_is_held_for_five_fresh_observations():
    seen, env = [], ScriptedEnv()
    z = torch.nn.functional.normalize(torch.ones(2, 7), dim=-1)
    decision = steered(env, seen).step(z)
    assert HOLD_STEPS == env.count == len(seen) == 5
    assert [float(obs[0, 0]) for obs, _ in seen] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert all(obs.shape == (2, 46) and latent is z for obs, latent in seen)
    assert decision.reward.tolist() == pytest.approx([1.0, 1.0])
    assert decision.error.tolist() == pytest.approx([0.2, 0.4])


def test_nothing_is_earned_after_a_fall_inside_a_decision():
    """Bug B9: the original goes on paying, for steps after the reset."""
    decision = steered(ScriptedEnv(falls=(2, 4))).step(torch.zeros(2, 7))
    assert decision.fell.tolist() == [True, False]
    assert not decision.timed_out.any()
    assert decision.reward.tolist() == pytest.approx([2 / 5, 1.0])
    # The error of the last step lived through, not of some later one.
    assert decision.error.tolist() == pytest.approx([1.0 / 2, 2.0 / 5])


def test_a_time_out_inside_a_decision_is_no_death():
    """Bug B9: the original sees a time-out in steps 1 to 4 as one; nor may a fall after it
    count.
    """
    decision = steered(ScriptedEnv(time_outs=(3,), falls=(4,))).step(torch.zeros(2, 7))
    assert decision.timed_out.tolist() == [True, False]
    assert not decision.fell.any()
    assert decision.done.tolist() == [True, False]
    assert decision.reward.tolist() == pytest.approx([3 / 5, 1.0])


def test_who_fell_has_no_time_out_later_in_the_decision():
    """It would be worth the value of a state that it never reached."""
    decision = steered(ScriptedEnv(falls=(2,), time_outs=(4,))).step(torch.zeros(2, 7))
    assert decision.fell.tolist() == [True, False]
    assert not decision.timed_out.any()


def test_forces_are_counted_in_every_substep_lived_through():
    """Bug B15: the original looks at one in twenty. Here two of four substeps, one foot of two."""
    decision = steered(ScriptedEnv(falls=(3,))).step(torch.zeros(2, 7))
    assert decision.above_limit.tolist() == [[6.0, 0.0], [10.0, 0.0]]
    assert decision.substeps.tolist() == [12.0, 20.0]


def test_the_original_looks_at_the_end_of_a_decision_only():
    """The largest force of the last 15 ms of its last step, of worlds that lived to it; here three
    of four substeps.
    """
    decision = steered(ScriptedEnv(falls=(3,))).step(torch.zeros(2, 7))
    assert decision.sampled.tolist() == [False, True]
    assert decision.sampled_above.tolist() == [[False, False], [True, False]]
    env = ScriptedEnv()
    early = steered(env)
    early.limit = LIMIT + 2.0
    step = env.step

    def first_substep_only(action):
        result = step(action)
        env.physics.foot_force[:, 0] = LIMIT + 3.0
        return result

    env.step = first_substep_only
    decision = early.step(torch.zeros(2, 7))
    assert decision.sampled.all() and decision.above_limit.sum() == 20.0
    assert not decision.sampled_above.any()


def test_the_last_latent_is_observed_and_forgotten_at_a_reset():
    """Bug B8: the original shows the last latent of the previous rollout."""
    env = steered(ScriptedEnv())
    assert env.observe()[:, -7:].abs().max() == 0.0
    z = torch.nn.functional.normalize(torch.arange(14.0).view(2, 7), dim=-1)
    env.step(z)
    assert torch.equal(env.observe()[:, -7:], z)
    env.reset(torch.tensor([True, False]))
    assert env.observe()[0, -7:].abs().max() == 0.0
    assert torch.equal(env.observe()[1, -7:], z[1])
    assert env.env.resets[0].tolist() == [True, False]


def test_every_control_step_can_be_watched():
    counts = []
    steered(ScriptedEnv()).step(torch.zeros(2, 7), lambda env: counts.append(env.count))
    assert counts == [1, 2, 3, 4, 5]


def test_observation_is_the_frame_the_target_and_the_latent(robot):
    task = replace(load_task(robot, "reach"), noise=0.0)
    env = steered(LeggedEnv(robot, task, 3, seed=0))
    joints = robot.num_joints
    seen = env.observe()
    assert seen.shape == (3, {12: 44, 19: 58}[joints])
    assert layout(env.terms)[-1]["slice"] == [seen.shape[1] - 7, seen.shape[1]]
    frame = 10 + 2 * joints
    assert torch.equal(seen[:, :frame], env.env.frame())
    target = env.env.task.command.observe(env.env.command, env.env.state)
    assert torch.equal(seen[:, frame : frame + 3], target)
    assert not seen[:, frame + 3 :].any()
