"""What policies are shown: layouts, histories, and an odometry that drifts."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.hierarchical_env import LatentSteeredEnv
from lacoloco.pipelines.sim.observation import (
    BY_ODOMETRY,
    FULL,
    Observation,
    ObservationConfig,
    observation_of,
    observed_terms,
)
from lacoloco.pipelines.sim.odometry import Odometry
from lacoloco.pipelines.sim.randomisation import NO_RANDOMISATION
from lacoloco.pipelines.sim.state import (
    RobotState,
    high_level_terms,
    layout,
    policy_terms,
    style_terms,
    width,
)
from lacoloco.pipelines.sim.tasks import imitate_task, load_task
from lacoloco.pipelines.sim.views import columns_of, privileged
from lacoloco.robots.numbers import OdometryDrift

ONBOARD = Observation(onboard=True, history=3)
READING = 3 + 3 + 12 + 12 + 12
"""Gravity, angular velocity, joint positions and velocities, last action of the Solo12."""
HIGH = high_level_terms(12, 7)


def columns(terms, name, steps_ago=0):
    rows = [
        row for row in layout(terms) if row["name"] == name and row.get("steps_ago", 0) == steps_ago
    ]
    return slice(*rows[0]["slice"])


def test_onboard_there_is_neither_height_nor_linear_velocity():
    terms = observed_terms(policy_terms(12), ONBOARD)
    names = [term.name for term in terms]
    assert names[:5] == [
        "projected_gravity",
        "base_ang_vel",
        "joint_pos",
        "joint_vel",
        "last_action",
    ]
    assert names == 3 * names[:5]
    assert [term.steps_ago for term in terms] == [0] * 5 + [1] * 5 + [2] * 5
    assert width(terms) == 3 * READING


def test_a_target_is_seen_by_odometry_and_has_no_history():
    terms = observed_terms(HIGH, ONBOARD)
    assert width(terms) == 30 + 3 + 7 + 2 * 30
    assert [term.frame for term in terms if term.name == "target"] == [BY_ODOMETRY]
    assert sum(term.name == "last_latent" for term in terms) == 1
    assert observed_terms(HIGH, FULL) == HIGH


@pytest.mark.parametrize("onboard", [False, True])
@pytest.mark.parametrize("history", [1, 6])
@pytest.mark.parametrize("terms", [policy_terms(12, memory=3), HIGH])
def test_a_layout_says_what_is_observed(terms, onboard, history):
    observation = Observation(onboard, history)
    assert observation_of(layout(observed_terms(terms, observation))) == observation


@pytest.mark.parametrize("age", [-1, 50, 1.0, True, "1"])
def test_a_layout_of_another_kind_is_refused(age):
    with pytest.raises(ValueError, match="control steps ago"):
        observation_of([{"name": "joint_pos", "steps_ago": age}])


def test_defaults_follow_from_what_is_measured():
    assert ObservationConfig().resolved() == ObservationConfig("full", 1, False)
    assert ObservationConfig().resolved("onboard") == ObservationConfig("onboard", 6, True)
    told = ObservationConfig("onboard", 2, False)
    assert told.resolved() == told and told.of_policy == Observation(True, 2)
    assert ObservationConfig().of_policy == FULL


def test_columns_are_found_in_the_readings():
    """Two readings of a height (1) and joints (2), then a target (3): joints now and before."""
    recorded = policy_terms(2)
    terms = observed_terms(recorded, Observation(onboard=True, history=2))
    joint_pos = columns_of(terms, recorded, 2)[columns(terms, "joint_pos", 1)]
    assert joint_pos == [width(recorded) + 10, width(recorded) + 11]


def walking(env, steps):
    """Random actions; the observations after each step."""
    seen = [env.observe()]
    for _ in range(steps):
        env.step(0.3 * torch.randn(env.num_worlds, env.num_actions))
        seen.append(env.observe())
    return seen


@pytest.fixture
def onboard_env(solo12):
    torch.manual_seed(0)
    task = imitate_task(solo12, constrained=False)
    return LeggedEnv(solo12, task, 4, seed=0, observation=ONBOARD)


def test_an_older_reading_is_what_was_read_with_its_noise(onboard_env):
    env = onboard_env
    seen = walking(env, 4)
    assert width(env.terms) == seen[-1].shape[1] == 3 * READING
    for now, before in zip(seen[1:], seen, strict=False):
        assert torch.equal(now[:, READING:], before[:, : 2 * READING])
    assert torch.equal(env.observe(), env.observe()), "one reading a control step"
    speeds = columns(env.terms, "joint_vel")
    off = seen[-1][:, speeds] - env.state.joint_vel
    assert 0.2 < off.abs().max() <= 1.5, "noisy"


def test_where_an_episode_begins_all_readings_are_its_first(onboard_env):
    env = onboard_env
    before = walking(env, 3)[-1]
    env.reset(torch.tensor([True, False, False, True]))
    seen = env.observe()
    first = seen[:, :READING]
    for age in (1, 2):
        same = seen[:, age * READING : (age + 1) * READING] == first
        assert same.all(dim=1).tolist() == [True, False, False, True]
    assert torch.equal(seen[1:3], before[1:3])


def test_an_environment_goes_on_from_its_state(onboard_env, solo12):
    env = onboard_env
    walking(env, 2)
    task = env.task
    other = LeggedEnv(solo12, task, 4, seed=7, observation=ONBOARD)
    other.load_state_dict(env.state_dict())
    action = 0.3 * torch.randn(4, 12)
    for one in (env, other):
        one.step(action)
    assert torch.equal(env.observe(), other.observe())


def test_without_noise_and_drift_the_view_is_the_state(solo12):
    env = steered(solo12, drift=OdometryDrift(0.0, 0.0))
    env.step(torch.zeros(3, 7))
    state, low, high = env.env.state, env.observe_low(), env.observe()
    assert torch.equal(low[:, :3], state.gravity_b) and torch.equal(high[:, :3], state.gravity_b)
    assert torch.equal(low[:, 3:6], state.ang_vel_b)
    assert torch.equal(low[:, 30:42], env.env.action)
    target = env.env.task.command.observe(env.env.command, state)
    assert torch.allclose(high[:, columns(env.terms, "target")], target, atol=1e-5)
    assert torch.equal(high[:, columns(env.terms, "last_latent")], env.latent)


def steered(solo12, drift, low_sees=ONBOARD, high_sees=ONBOARD):
    task = replace(load_task(solo12, "reach"), noise=0.0, randomisation=NO_RANDOMISATION)
    base = LeggedEnv(replace(solo12, odometry=drift), task, 3, seed=0)

    def low(observation, z):
        return 0.2 * torch.ones(len(observation), 12)

    return LatentSteeredEnv(base, low, 7, low_sees, high_sees)


def test_levels_may_observe_different_things(solo12):
    env = steered(solo12, OdometryDrift(), FULL, Observation(onboard=False, history=2))
    z = torch.nn.functional.normalize(torch.ones(3, 7), dim=1)
    env.step(z)
    assert torch.equal(env.observe_low(), env.env.observe()[:, :46])
    seen = env.observe()
    assert seen.shape[1] == 44 + 34
    assert torch.equal(seen[:, :34], env.env.frame())
    assert not torch.equal(seen[:, 44:], env.env.frame()), "a control step before"


def test_a_drift_moves_the_target_away(solo12):
    """Half of the way is wrong: at the target itself the robot believes to be elsewhere."""
    env = steered(solo12, OdometryDrift(distance=0.5, heading=0.0))
    base = env.env
    target = columns(env.terms, "target")
    honest = base.task.command.observe(base.command, base.state)
    assert torch.allclose(env.observe()[:, target], honest, atol=1e-6), "right at the start"
    base.physics.push(torch.arange(3), torch.tensor([[1.0, 0, 0, 0, 0, 0]] * 3))
    base._read()
    for _ in range(3):
        env.step(torch.zeros(3, 7))
    honest = base.task.command.observe(base.command, base.state)
    off = (env.observe()[:, target] - honest).norm(dim=1)
    gone = base.readings.odometry.offset.norm(dim=1)
    assert torch.allclose(off, gone, atol=1e-5) and gone.max() > 0.02


def state_at(x, y=0.0, heading=0.0):
    qpos = torch.zeros(1, 19)
    qpos[:, 0], qpos[:, 1] = x, y
    qpos[:, 3], qpos[:, 6] = np.cos(heading / 2), np.sin(heading / 2)
    return RobotState.from_generalized(qpos, torch.zeros(1, 18))


def test_odometry_counts_a_share_of_the_way_too_much():
    """One metre ahead, then, turned to the left, one to the side; 10 % and 20 % are wrong."""
    odometry = Odometry(OdometryDrift(0.0, 0.0), state_at(0.0), seed=0)
    odometry._scale[:] = torch.tensor([0.1, 0.2, 0.0])
    odometry.advance(state_at(1.0))
    assert odometry.offset[0].tolist() == pytest.approx([0.1, 0.0, 0.0])
    left = state_at(1.0, 1.0, heading=np.pi / 2)
    odometry.advance(left)
    assert odometry.offset[0].tolist() == pytest.approx([0.1, 0.1, 0.0], abs=1e-6), "ahead again"
    odometry.advance(state_at(0.0, 1.0, heading=np.pi / 2))
    assert odometry.offset[0].tolist() == pytest.approx([-0.1, 0.1, 0.0], abs=1e-6)
    assert odometry.reading(left).root_pos[0].tolist() == pytest.approx([0.9, 1.1, 0.0], abs=1e-6)
    odometry.restart(torch.tensor([0]), left)
    assert not odometry.offset.any() and odometry.reading(left).root_pos[0, 0] == 1.0


def test_a_heading_that_turns_away_bends_the_way():
    odometry = Odometry(OdometryDrift(0.0, 0.0), state_at(0.0), seed=0)
    odometry.turn[:] = torch.pi / 2
    odometry.advance(state_at(1.0))
    assert odometry.offset[0].tolist() == pytest.approx([-1.0, 1.0, 0.0], abs=1e-6)
    odometry._rate[:] = 0.5
    odometry.advance(state_at(1.0))
    assert float(odometry.turn) == pytest.approx(np.pi / 2 + 0.01)


def test_errors_stay_in_their_ranges_and_differ():
    many = RobotState.from_generalized(torch.zeros(500, 19), torch.zeros(500, 18))
    odometry = Odometry(OdometryDrift(0.02, 0.001), many, seed=0)
    assert 0.019 < odometry._scale.abs().max() <= 0.02
    assert 0.0009 < odometry._rate.abs().max() <= 0.001
    assert odometry._scale.std(dim=0).min() > 0.01


def test_a_critic_sees_the_clean_state_and_the_world(solo12):
    env = LeggedEnv(solo12, load_task(solo12, "reach"), 3, seed=0)
    seen = privileged(env)
    assert seen.shape == (3, width(style_terms(12)) + 9 - 1 + 4 + 3)
    assert torch.equal(seen[:, :34], env.frame())
    assert torch.equal(seen[:, 34], env.parameters.friction)
    assert torch.equal(seen[:, -3:], env.task.command.observe(env.command, env.state))
    assert not torch.equal(env.observe()[:, :34], env.frame()), "the policy's view is noisy"
