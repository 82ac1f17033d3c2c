"""A chain without motion capture, in its smallest size: what was observed in training is observed
ever after, without an option.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from lacoloco.datasets import published
from lacoloco.datasets.artifact import read_artifact
from lacoloco.datasets.clip import save_clips
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines import evaluate, export, train_high, train_low
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation.policy_coverage import policy_coverage
from lacoloco.pipelines.evaluation.rollout import record_low, record_reach
from lacoloco.pipelines.exporting.controller import Controller, Safety, Sensors
from lacoloco.pipelines.learn.latents import project
from lacoloco.pipelines.low_level.trainer import LowTrainer
from lacoloco.pipelines.policies import load_policies, steered
from lacoloco.pipelines.robot import record_of
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.observation import Observation, ObservationConfig
from lacoloco.pipelines.sim.randomisation import NO_RANDOMISATION
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.pipelines.stage import StageContext
from lacoloco.robots.numbers import OdometryDrift
from lacoloco.robots.registry import load_robot

HISTORY = 6


@pytest.fixture(scope="module")
def chain(tmp_path_factory, make_clips):
    """Both levels; the high level is not told, and follows the low one."""
    folder = tmp_path_factory.mktemp("runs")
    solo12, motions = load_robot("solo12"), folder / "motions.h5"
    save_clips(motions, make_clips(solo12), robot=record_of(solo12), config={})
    context = StageContext(RunStore(folder), "onboard")
    onboard = ObservationConfig("onboard")
    config = replace(train_low.smoke(), worlds=4, coverage_latents=2, observation=onboard)
    low = train_low.run(config, context, motions=[motions]).artifact
    high = train_high.run(replace(train_high.smoke(), worlds=4), context, low=low).artifact
    return SimpleNamespace(context=context, motions=motions, low=low, high=high)


@pytest.fixture(scope="module")
def folder(chain):
    return export.run(export.PRESETS["smoke"](), chain.context, policy=chain.high).artifact.parent


def test_both_levels_observe_what_is_on_board(chain):
    _, policies = load_policies(chain.high, "low", "high")
    assert policies["low"].head.sizes["policy"] == HISTORY * 42
    assert policies["high"].head.sizes["policy"] == HISTORY * 30 + 3 + 7
    for policy in policies.values():
        assert policy.head.observation == Observation(True, HISTORY)
        assert policy.actor.obs_dim == sum(policy.head.sizes.values())
    for path in (chain.low, chain.high):
        stored = read_artifact(path).config["observation"]
        assert stored == {"measured": "onboard", "history": 6, "privileged_critic": True}


def test_it_is_evaluated_and_played_as_it_was_trained(chain):
    config = evaluate.EvalConfig(episodes=2, selection_episodes=1, worlds=2)
    row = evaluate.run(config, chain.context, policies=[chain.high]).metrics["rows"][0]
    assert row["episodes"] == 2 and np.isfinite(row["ee_error_mean_m"])
    played = record_reach(chain.high, seconds=0.2, episodes=2)
    assert played.low_obs.shape == (20, HISTORY * 42)
    assert played.high_obs.shape == (4, HISTORY * 30 + 10)
    assert played.frame.shape == (2, 10, 34) and played.action.shape == (2, 10, 12)
    assert record_low(chain.low, seconds=0.1).qpos.shape == (1, 5, 19)
    assert policy_coverage(chain.low, [chain.motions], latents=2, seed=0)


def test_a_high_level_without_motion_capture_needs_such_a_low_level(chain):
    config = replace(train_high.smoke(), observation=ObservationConfig("onboard"))
    low = published.find("solo12-synthetic-low")
    with pytest.raises(StageError, match="train-low --observe onboard"):
        train_high.run(config, chain.context, low=low)


def test_the_controller_sees_what_the_simulated_robot_sees(chain, folder):
    """Three decisions, without noise and drift, by IMU, joints and odometry alone."""
    assert set(export.check(folder)) == {"low.onnx", "high.onnx", "robot.xml", "controller.py"}
    controller = Controller(folder, Safety(rise_s=0.0, stand_s=0.0, slew=1e6))
    targets, commands = [], []
    base, env, policies = simulated(chain)
    step = base.physics.step

    def watched(joints):
        qpos, qvel = base.physics.qpos[0].numpy(), base.physics.qvel[0].numpy()
        sensors = Sensors(
            time=0.0,
            joint_pos=qpos[7:],
            joint_vel=qvel[6:],
            base_quat=qpos[3:7],
            base_ang_vel=qvel[3:6],
            base_pos=qpos[:3],
        )
        commands.append(controller.step(sensors, base.command[0].numpy(), 0.0).position)
        targets.append(joints[0].numpy())
        step(joints)

    base.physics.step = watched
    for _ in range(3):
        env.step(project(policies["high"](env.observe())))
    assert controller.reason == "" and len(commands) == 15
    np.testing.assert_allclose(commands, targets, atol=1e-4)


def simulated(chain):
    _, policies = load_policies(chain.high, "low", "high")
    solo12 = replace(load_robot("solo12"), odometry=OdometryDrift(0.0, 0.0))
    task = replace(load_task(solo12, "reach"), noise=0.0, randomisation=NO_RANDOMISATION)
    base = LeggedEnv(solo12, task, 1, seed=0)
    return base, steered(base, policies), policies


def test_the_description_says_what_is_needed(folder):
    controller = Controller(folder)
    terms = controller.policy["levels"]["high"]["observation_terms"]
    assert {term["name"] for term in terms} == {
        "projected_gravity",
        "base_ang_vel",
        "joint_pos",
        "joint_vel",
        "target",
        "last_latent",
    }
    target = next(term for term in terms if term["name"] == "target")
    assert target["frame"] == "base, by odometry" and "odometry" in target["meaning"]
    assert max(term.get("steps_ago", 0) for term in terms) == HISTORY - 1


def test_a_history_and_a_critic_come_without_the_rest_too(solo12, motions):
    observation = ObservationConfig("full", 2, True)
    config = replace(train_low.smoke(), observation=observation, bc_steps=0)
    trainer = LowTrainer(solo12, motions, config, seed=0, device="cpu")
    assert np.isfinite(trainer.iterate(0.0)["value"])
    assert trainer.head.sizes == {"policy": 2 * 46, "latent": 7}
    assert trainer.head.observation == Observation(False, 2)
    assert trainer.algorithm.critic.obs_dim == 2 * 46 + 7 + 34 + 12
