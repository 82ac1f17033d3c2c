"""The controller that an exported folder brings along."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lacoloco.datasets import published
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines import export
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.exporting.controller import Controller, Safety, Sensors, observe
from lacoloco.pipelines.stage import StageContext

STRANGER = Path(__file__).with_name("play_in_mujoco.py")
STANDING = Safety(rise_s=0.0, stand_s=0.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The published policy of the Solo12, exported."""
    context = StageContext(RunStore(tmp_path_factory.mktemp("runs")), "run")
    policy = published.find("solo12-synthetic")
    result = export.run(export.PRESETS["smoke"](), context, policy=policy)
    return result.artifact.parent


@pytest.fixture
def sensors(folder):
    """A robot that stands still in its default pose."""
    policy = json.loads((folder / "policy.json").read_text())
    return Sensors(
        time=0.0,
        joint_pos=np.array(policy["default_joint_pos"]),
        joint_vel=np.zeros(len(policy["joint_names"])),
        base_quat=np.array([1.0, 0.0, 0.0, 0.0]),
        base_ang_vel=np.zeros(3),
        base_pos=np.array([0.0, 0.0, policy["default_base_height"]]),
        base_lin_vel=np.zeros(3),
    )


TARGET = np.array([1.5, 0.0, 0.3])


def test_the_gains_rise_while_the_joints_hold_and_then_the_robot_stands_up(folder, sensors):
    crouched = replace(sensors, joint_pos=sensors.joint_pos + 0.3)
    controller = Controller(folder)
    half = [controller.step(replace(crouched, time=t), TARGET, t) for t in (0.0, 0.5)][1]
    assert half.mode == "rise"
    assert half.position == pytest.approx(crouched.joint_pos, abs=1e-6)
    assert half.stiffness == pytest.approx(0.5 * np.array(controller.policy["joint_stiffness"]))
    now = 0.52
    while (command := controller.step(replace(crouched, time=now), TARGET, now)).mode != "run":
        before, now = command, now + controller.policy["control_dt"]
    assert before.mode == "stand"
    assert before.position == pytest.approx(sensors.joint_pos, abs=0.01)


def test_a_high_level_decision_is_held_for_five_steps(folder, sensors):
    controller, latents = Controller(folder, STANDING), []
    for step in range(11):
        moved = replace(sensors, time=0.02 * step, base_pos=sensors.base_pos + 0.01 * step)
        controller.step(moved, TARGET, 0.02 * step)
        latents.append(controller._latent.copy())
    different = [step for step in range(1, 11) if not np.array_equal(*latents[step - 1 : step + 1])]
    assert different == [5, 10]
    assert np.linalg.norm(latents[-1]) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"time": -0.2}, "old"),
        ({"base_lin_vel": None}, "not measured: base_lin_vel"),
        ({"base_pos": None}, "not measured: base_height, target"),
        ({"joint_vel": np.full(12, np.nan)}, "not a number"),
        ({"base_quat": np.array([0.5, 0.9, 0.0, 0.0])}, "tilted"),
    ],
)
def test_what_is_wrong_stops_the_robot_for_good_and_softly(folder, sensors, wrong, reason):
    controller = Controller(folder, STANDING)
    assert controller.step(sensors, TARGET, 0.0).mode == "run"
    stopped = controller.step(replace(sensors, **wrong), TARGET, 0.0)
    assert stopped.mode == "stop" and reason in controller.reason
    assert not stopped.stiffness.any() and stopped.damping.all()
    assert controller.step(sensors, TARGET, 0.0).mode == "stop", "until a person starts it anew"


def test_targets_change_no_faster_than_the_limit_and_stay_in_the_joints_ranges(folder, sensors):
    controller = Controller(folder, replace(STANDING, slew=1.0))
    lower, upper = np.array(controller.policy["joint_ranges"]).T
    position = sensors.joint_pos
    for step in range(20):
        moved = replace(sensors, time=0.02 * step)
        command = controller.step(moved, TARGET, 0.02 * step)
        assert np.abs(command.position - position).max() <= 0.02 + 1e-6
        assert (command.position >= lower - 1e-6).all()
        assert (command.position <= upper + 1e-6).all()
        position = command.position


def test_a_target_is_seen_from_the_base_with_its_whole_orientation(sensors):
    """Pitched by 90 degrees, the base's x axis points down: a point below is ahead."""
    half = np.sqrt(0.5)
    pitched = replace(sensors, base_quat=np.array([half, 0.0, half, 0.0]))
    seen = observe(pitched, pitched.base_pos + [0.0, 0.0, -1.0])
    assert seen["target"] == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)
    assert seen["projected_gravity"] == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)


def test_files_that_do_not_belong_together_are_refused(folder, tmp_path):
    copy = tmp_path / "robot"
    copy.mkdir()
    for path in folder.iterdir():
        (copy / path.name).write_bytes(path.read_bytes())
    assert set(export.check(copy)) == {"low.onnx", "high.onnx", "robot.xml", "controller.py"}
    (copy / "low.onnx").write_bytes((folder / "high.onnx").read_bytes())
    with pytest.raises(ValueError, match="low.onnx: not the file"):
        Controller(copy)
    (copy / "low.onnx").unlink()
    with pytest.raises(StageError, match="low.onnx: missing"):
        export.check(copy)
    with pytest.raises(StageError, match="give a folder of lacoloco export"):
        export.check(tmp_path)


@pytest.mark.slow
def test_a_stranger_reaches_targets_in_plain_mujoco_at_1_khz(folder):
    """``play_in_mujoco.py FOLDER 100 1000`` counts 100 episodes, these twelve are a sample."""
    command = [sys.executable, "-I", str(STRANGER), str(folder), "12", "500"]
    played = subprocess.run(command, capture_output=True, text=True, check=True)
    result = json.loads(played.stdout)
    assert sum(error < 0.05 for error in result["errors"]) >= 8
