"""The benchmarks' answers; how fast anything is, is no matter of tests."""

from dataclasses import replace

import pytest
import torch

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.benchmarks.throughput import PRESETS, bench_sim, bench_train, made_up_clips
from lacoloco.pipelines.sim.bare_engine import bare_engine
from lacoloco.pipelines.sim.engines import make_physics
from lacoloco.pipelines.sim.physics import PhysicsRequest
from lacoloco.robots.errors import RobotError

SMOKE = PRESETS["smoke"]()


@pytest.mark.parametrize("task", ["walk", "reach_in_place", "imitate", "reach"])
def test_every_task_can_be_measured(task):
    answer = bench_sim(SMOKE, robot="solo12", task=task)
    assert {"steps_per_second", "engine_steps_per_second", "ratio_to_engine"} <= set(answer)
    # Of a few steps on a busy machine either rate may be the larger one.
    assert answer["ratio_to_engine"] > 0.0
    assert sum(answer["shares"].values()) == pytest.approx(1.0)
    assert {"physics", "observations", "resets", "rewards"} <= set(answer["shares"])
    assert (answer["task"], answer["worlds"]) == (task, SMOKE.worlds)


@pytest.mark.parametrize(("disc", "cat"), [("drail", True), ("gan", False)])
def test_the_whole_training_is_measured_part_by_part(disc, cat):
    answer = bench_train(SMOKE, robot="solo12", disc=disc, cat=cat)
    assert answer["method"] == ("drail-cat" if cat else "gan")
    assert answer["steps_per_second"] > 0.0
    assert answer["ratio_to_engine"] > 0.0
    assert sum(answer["shares"].values()) == pytest.approx(1.0)
    assert set(answer["shares"]) == {
        "physics",
        "environment",
        "policy inference",
        "style rewards",
        "demonstrations",
        "discriminator and encoder",
        "actor and critic",
        "returns",
        "rest of the loop",
    }


def test_an_unknown_robot_is_refused():
    with pytest.raises(RobotError, match="solo13"):
        bench_sim(SMOKE, robot="solo13")


def test_made_up_clips_are_clips_of_the_robot(robot):
    library = MotionLibrary(made_up_clips(robot, 3, seconds=1.0))
    frames = library.frames(torch.arange(3), torch.full((3,), 0.5))
    assert library.joint_names == robot.joint_names
    forward = torch.tensor([0.3, 0.0, 0.0]).expand(3, 3)
    assert torch.allclose(frames.root_lin_vel_b, forward, atol=1e-4)


def test_the_bare_engine_does_the_same_physics(solo12):
    """From the same state under the same targets: nothing is left out of what is compared."""
    physics = make_physics(PhysicsRequest(solo12, 3, threads=1))
    qpos = physics.qpos.clone()
    qpos[:, 2] += 0.02 * torch.arange(3)
    physics.reset(torch.arange(3), qpos, torch.zeros(3, 18))
    targets = torch.tensor(solo12.default_joint_pos) + 0.1 * torch.randn(5, 3, 12)
    engine = bare_engine(physics)
    engine.load(targets)
    engine.run()
    for row in targets:
        physics.step(row)
    assert torch.equal(torch.from_numpy(engine.batch.state), physics.state_dict()["rows"])


@pytest.mark.parametrize("name", ["gpu", "paper"])
def test_presets_differ_in_size_only(name):
    assert PRESETS[name]() == replace(PRESETS["laptop"](), worlds=4096, recipe=name)


def test_rounds_end_with_their_time_but_not_before_the_second():
    assert list(replace(SMOKE, rounds=5).turns()) == [0, 1, 2, 3, 4]
    assert list(replace(SMOKE, rounds=5, seconds=0.0).turns()) == [0, 1]
