"""Experts that say what they would do where a policy is."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lacoloco.datasets import published
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation.hardware_shift import IN_TRAINING
from lacoloco.pipelines.generate import smoke
from lacoloco.pipelines.generation.config import smoke_expert
from lacoloco.pipelines.generation.expert_trainer import ExpertTrainer
from lacoloco.pipelines.generation.recorder import record
from lacoloco.pipelines.low_level.expert_labels import ExpertLabels
from lacoloco.pipelines.low_level.expert_worlds import _states_before
from lacoloco.pipelines.policies import load_policies
from lacoloco.pipelines.sim.clip_actions import clip_states, infer_actions, with_memory
from lacoloco.pipelines.sim.gait.clock import MEMORY, MEMORY_UNIT
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.state import style_frame
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.pipelines.stage import StageContext

SECONDS = 0.4
QUIET = (torch.zeros(()), 0.0)


@pytest.fixture
def recorded(robot, make_context):
    """Two walking clips and the expert that performed them, and a scale of imitation actions."""
    expert = ExpertTrainer(robot, "walk", smoke_expert(), seed=0, device="cpu").policy()
    config = replace(smoke(), seconds=SECONDS)
    clips, _ = record(robot, "walk", expert, 2, config, make_context())
    return clips, {"walk": expert}


@pytest.fixture
def make_context(tmp_path):
    """Factory of contexts with a run of their own."""
    from lacoloco.datasets.store import RunStore

    return lambda: StageContext(RunStore(tmp_path / "runs"), "run")


def labels_for(robot, clips, experts, worlds=8, shifted=False):
    library = MotionLibrary(clips)
    states = clip_states(library)
    return ExpertLabels(
        robot, library, states, experts, worlds=worlds, hold_steps=149, seed=0, shifted=shifted
    ), states


def test_a_policy_that_does_what_was_recorded_is_told_the_same(robot, recorded):
    """The policy replays the clip's own actions: the expert says them again, row by row."""
    clips, experts = recorded
    labels, states = labels_for(robot, clips, experts)
    task = load_task(robot, "imitate")
    moves = infer_actions(robot, states, task.action_scale)
    actions, previous = with_memory(states, moves, task.memory)
    assert actions.shape == previous.shape == (len(moves), robot.num_joints + task.memory)
    for worlds in labels.experts.values():
        env = worlds.env
        env.task = replace(env.task, randomisation=replace(env.task.randomisation, push=0.0))
        worlds._performs[:] = True
    told, falls = labels.collect(lambda observation, rows: actions[rows], *QUIET)
    assert len(told) == 8 * round(SECONDS / 0.02)
    assert falls == 0.0
    # What follows the last state of a clip is not told.
    known = told.rows != states.last[told.rows]
    told = replace(told, actions=told.actions[known], rows=told.rows[known])
    same = (told.actions - actions[told.rows]).abs().max(dim=1).values
    # Masses and friction are drawn anew, so that the robots part in the end.
    assert same[told.rows == states.first[0]].max() < 1e-4
    assert same.median() < 0.05


def test_states_are_the_policys_own_and_labels_the_experts(robot, recorded):
    """A policy that asks for another pose moves away from the clip and is contradicted."""
    clips, experts = recorded
    labels, states = labels_for(robot, clips, experts)
    for worlds in labels.experts.values():
        worlds._performs[:] = True
    asked = 0.3 * torch.ones(robot.num_joints + load_task(robot, "imitate").memory)
    told, _ = labels.collect(lambda observation, rows: asked.expand(len(rows), -1), *QUIET)
    moved = (told.frames - states.flattened().frames[told.rows]).abs().max(dim=1).values
    assert moved.max() > 10 * moved[told.rows == states.first[0]].max().clamp_min(1e-3)
    own = torch.isclose(told.previous, asked, atol=1e-5).all(dim=1)
    assert own.any() and not own.all()
    assert not (told.actions == asked).all(dim=1).any()


def test_clips_that_do_not_say_what_was_commanded_are_refused(solo12, recorded):
    clips, experts = recorded
    silent = [replace(clip, command=None) for clip in clips]
    if clips[0].joint_names != solo12.joint_names:
        pytest.skip("one robot is enough")
    with pytest.raises(StageError, match="expert_rounds=0"):
        labels_for(solo12, silent, experts)


def test_an_expert_reads_its_clock_from_the_policys_memory(h1, walks_and_reaches):
    """What the policy says about the clock is what the expert's next answer begins with."""
    labels, _ = labels_for(h1, *walks_and_reaches)
    worlds = labels.experts["walk"]
    said = torch.zeros(8, h1.num_joints + MEMORY)
    said[:, h1.num_joints] = 1.0 / MEMORY_UNIT  # a quarter of the cycle
    worlds._begin(torch.ones(8, dtype=torch.bool))
    worlds._last_action[:] = said
    worlds.env.command[:] = torch.tensor([0.5, 0.0, 0.0])
    _, asked, taken = worlds._step(said)
    angle = torch.atan2(asked[:, -3], asked[:, -2]) / (2.0 * torch.pi)
    later = 0.25 + CONTROL_DT / h1.gait.period
    assert torch.allclose(angle, torch.full((8,), later), atol=1e-5)
    assert torch.equal(taken, said)


def test_a_policy_is_asked_with_the_noise_of_training(robot, recorded):
    """What it sees is off by the noise, what it did is kept with it; labelled states are clean."""
    clips, experts = recorded
    labels, states = labels_for(robot, clips, experts)
    seen, width = [], 10 + 3 * robot.num_joints + load_task(robot, "imitate").memory

    def student(observation, rows):
        seen.append(observation)
        return torch.zeros(len(rows), width - 10 - 2 * robot.num_joints)

    noise = torch.zeros(width)
    noise[1] = 0.05
    told, _ = labels.collect(student, noise, 0.02)
    clean = torch.cat((told.frames, told.previous), dim=1)
    off = torch.cat(seen) - clean
    assert off[:, 2:].abs().max() == 0.0 and 0.02 < off[:, 1].abs().max() <= 0.05
    own = told.previous[(told.previous.abs() < 0.1).all(dim=1)]
    assert 0.01 < own[own != 0.0].std() < 0.03


def test_in_shifted_worlds_a_policy_is_asked_about_what_its_sensors_say(solo12, recorded):
    """Encoders that are off show other joint positions than there are; an expert sees the same."""
    clips, experts = recorded
    if clips[0].joint_names != solo12.joint_names:
        pytest.skip("one robot is enough")
    labels, _ = labels_for(solo12, clips, experts, shifted=True)
    env = labels.experts["walk"].env
    assert env.task.disturbances == IN_TRAINING.apply(env.task).disturbances
    seen = []

    def student(observation, rows):
        there = style_frame(env.state)
        assert env.observe()[:, : there.shape[1]].equal(observation[:, : there.shape[1]])
        seen.append(observation[:, : there.shape[1]] - there)
        return torch.zeros(len(rows), solo12.num_joints)

    width = 10 + 3 * solo12.num_joints
    told, _ = labels.collect(student, torch.zeros(width), 0.0)
    assert torch.cat(seen).abs().max() > 0.01
    assert told.frames.shape[1] == seen[0].shape[1]


def test_states_know_which_one_was_before():
    """Three steps of two worlds; the second begins anew in the last step, and one is not known."""
    began = torch.tensor([[True, True], [False, False], [False, True]])
    known = torch.tensor([True, True, False, True, True, True])
    assert _states_before(known, began).tolist() == [0, 1, 1, 3, 4]


def test_a_policy_is_asked_with_its_history(solo12, recorded):
    clips, experts = recorded
    if clips[0].joint_names != solo12.joint_names:
        pytest.skip("one robot is enough")
    labels, _ = labels_for(solo12, clips, experts)
    seen, width = [], 10 + 3 * solo12.num_joints

    def student(readings, rows):
        seen.append(readings)
        return 0.1 * torch.randn(len(rows), solo12.num_joints)

    told, _ = labels.collect(student, torch.zeros(width), 0.0, history=2)
    assert torch.equal(seen[0][:, :width], seen[0][:, width:])
    assert torch.equal(seen[1][:, width:], seen[0][:, :width])
    moved = told.before != torch.arange(len(told))
    assert moved.any()
    shown = torch.cat(seen)
    clean = torch.cat((told.frames, told.previous), dim=1)
    both = torch.cat((clean, clean[told.before]), dim=1)
    assert torch.equal(shown, both)


def test_an_expert_leads_the_arm_on_from_where_the_policy_has_it(h1, walks_and_reaches):
    """A policy that holds the arm still is told one small step at a time, not what has piled up."""
    labels, states = labels_for(h1, *walks_and_reaches)
    hold = torch.zeros(h1.num_joints + MEMORY)
    told, _ = labels.collect(lambda observation, rows: hold.expand(len(rows), -1), *QUIET)
    arm = [i for i, name in enumerate(h1.joint_names) if name.startswith("right_")][5:]
    of_reaching = told.rows >= len(states.last) // 2
    held = of_reaching & (told.previous[:, : h1.num_joints] == 0.0).all(dim=1)
    scale = load_task(h1, "imitate").action_scale
    assert held.sum() > 50
    # At most 2 rad/s for a control step, and what the expert adds.
    led = (scale * told.actions[held][:, arm]).abs()
    assert led.median() < 0.1
    assert led.quantile(0.99) < 0.5


def test_clips_keep_what_was_commanded(robot, recorded, tmp_path):
    from lacoloco.datasets.clip import load_clips, save_clips

    clips, _ = recorded
    file = tmp_path / "motions.h5"
    save_clips(file, clips, robot=(robot.name, robot.model_hash()), config={})
    read = load_clips(file)
    assert np.array_equal(read[0].command, clips[0].command)
    assert (read[0].gait_memory is None) == (robot.gait is None)
    if robot.gait is not None:
        assert np.array_equal(read[0].gait_memory, clips[0].gait_memory)
    slower = read[0].resample(25.0)
    assert slower.command is None and slower.gait_memory is None


@pytest.fixture
def walks_and_reaches(h1, make_context):
    """A second of two clips of both published experts of the H1, and the experts."""
    _, experts = load_policies(published.find("h1-experts"))
    config, clips = replace(smoke(), seconds=1.0), []
    for task, expert in experts.items():
        clips += record(h1, task, expert, 2, config, make_context())[0]
    return clips, experts


def test_states_from_which_nothing_saves_the_robot_do_not_count(h1, walks_and_reaches):
    """A policy that bends every joint falls; the last 0.4 s before a fall are left out."""
    labels, _ = labels_for(h1, *walks_and_reaches)
    bent = torch.full((h1.num_joints + MEMORY,), 1.0)
    told, falls = labels.collect(lambda observation, rows: bent.expand(len(rows), -1), *QUIET)
    steps = 2 * 8 * round(1.0 / 0.02)
    assert falls > 0
    assert len(told) <= steps - 10 * round(falls * steps / 1000.0)


def test_who_walks_on_command_also_comes_to_rest_for_the_clips_of_others(h1, walks_and_reaches):
    labels, states = labels_for(h1, *walks_and_reaches)
    walks, reaches = (labels.experts[name]._watched for name in ("walk", "reach_in_place"))
    rows = len(states.last)
    assert walks.stops.tolist() == [False] * (rows // 2) + [True] * (rows // 2)
    assert not walks.commands[walks.stops].any() and len(walks.rows) == rows
    assert reaches.rows.tolist() == list(range(rows // 2, rows)) and not reaches.stops.any()
