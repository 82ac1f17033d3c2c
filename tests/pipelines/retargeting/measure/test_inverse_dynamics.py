import numpy as np
import pytest

from lacoloco.datasets import rotations
from lacoloco.datasets.clip import Clip
from lacoloco.pipelines.retargeting.measure.inverse_dynamics import inverse_dynamics
from lacoloco.robots.loading import robot_from_files
from lacoloco.robots.registry import load_robot

SPEC = load_robot("solo12")
WEIGHT = SPEC.weight()


def clip(height=lambda time: 0 * time, yaw=0.0, frames=12, fps=50.0):
    """The default pose, its base this much above where it stands."""
    q = np.tile(SPEC.default_qpos(), (frames, 1))
    q[:, 2] += height(np.arange(frames) / fps)
    quat = np.tile(rotations.from_yaw(np.array(yaw)), (frames, 1))
    return Clip.from_poses("pose", fps, SPEC.joint_names, q[:, :3], quat, q[:, 7:])


def standing(frames=12, feet=(True,) * 4):
    return np.tile(feet, (frames, 1))


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_standing_feet_carry_the_weight(yaw):
    efforts = inverse_dynamics(SPEC, clip(yaw=yaw), standing())
    np.testing.assert_allclose(efforts.forces.sum(1)[:, 2], WEIGHT, rtol=0.01)
    assert efforts.missing.max() < 0.01 * WEIGHT
    # left and right mirror each other, and no motor is near its limit
    left, right = efforts.torques[0, [0, 6]], efforts.torques[0, [3, 9]]
    np.testing.assert_allclose(left, -right, atol=1e-3)
    assert np.abs(efforts.torques).max() < 0.5


def test_torques_hold_against_the_forces_by_virtual_work():
    """A motor's torque does the work that gravity and the ground's forces undo."""
    pin = pytest.importorskip("pinocchio")
    model = SPEC.pinocchio_model()
    efforts = inverse_dynamics(SPEC, clip(), standing())
    q = np.r_[SPEC.default_qpos()[:3], 0, 0, 0, 1, SPEC.default_joint_pos]
    data, knee, small = model.createData(), 2, 1e-6
    step = np.zeros(model.nv)
    step[6 + knee] = small

    def energy(q):
        potential = pin.computePotentialEnergy(model, data, q)
        pin.framesForwardKinematics(model, data, q)
        feet = [model.getFrameId(foot, pin.FrameType.BODY) for foot in SPEC.feet]
        spots = [data.oMf[foot].translation.copy() for foot in feet]
        return potential, np.array(spots)

    (before, spots), (after, moved) = energy(q), energy(pin.integrate(model, q, step))
    # the foot rolls: the ground pushes at the bottom of the sphere, which turns with the leg
    turn = np.array([0, small, 0])
    moved[0] += np.cross(turn, [0, 0, -SPEC.foot_radius()])
    work = (efforts.forces[0] * (moved - spots)).sum()
    assert efforts.torques[0, knee] == pytest.approx((after - before - work) / small, abs=1e-3)


def test_a_foot_may_have_the_name_of_a_joint():
    files = {name: text.replace("_FOOT", "_KFE") for name, text in SPEC.files().items()}
    renamed = robot_from_files(files)
    assert renamed.feet == tuple(f"{leg}_KFE" for leg in ("FL", "FR", "HL", "HR"))
    here, there = (inverse_dynamics(spec, clip(), standing()) for spec in (SPEC, renamed))
    np.testing.assert_array_equal(here.torques, there.torques)


def test_in_free_fall_nothing_is_missing():
    efforts = inverse_dynamics(
        SPEC, clip(lambda time: 1 - 0.5 * 9.81 * time**2), standing(feet=(False,) * 4)
    )
    assert efforts.missing.max() < 1e-6 * WEIGHT
    assert np.abs(efforts.torques).max() < 1e-6


def test_hanging_in_the_air_misses_the_weight():
    efforts = inverse_dynamics(SPEC, clip(), standing(feet=(False,) * 4))
    np.testing.assert_allclose(efforts.missing, WEIGHT, rtol=1e-9)


def test_two_frames_are_at_rest():
    efforts = inverse_dynamics(SPEC, clip(frames=2), standing(2))
    assert efforts.missing.max() < 0.01 * WEIGHT
