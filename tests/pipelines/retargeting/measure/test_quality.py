import numpy as np
import pytest

from lacoloco.pipelines.retargeting.measure.quality import (
    course_quality,
    effort_quality,
    foot_quality,
    joint_quality,
    keypoint_errors,
)

RADIUS, FPS = 0.02, 50.0


@pytest.fixture
def feet():
    """Two feet that stand for ten frames."""
    feet = np.zeros((10, 2, 3))
    feet[..., 2] = RADIUS
    return feet


def test_feet_that_stand_are_blameless(feet):
    metrics = foot_quality(feet, np.ones((10, 2), bool), RADIUS, FPS)
    assert metrics == {
        "foot_skate_mean_m_s": 0.0,
        "ground_penetration_max_m": 0.0,
        "stance_float_max_m": 0.0,
        "contact_agreement": 1.0,
        "stance_share": 1.0,
        "low_foot_slip_mean_m_s": 0.0,
    }


def test_skating_counts_while_the_paw_stands_only(feet):
    contacts = np.ones((10, 2), bool)
    contacts[5:, 0] = False
    feet[5:, 0, 0] = np.arange(5)  # moves after it is lifted
    feet[:, 1, 1] = 0.01 * np.arange(10)  # slides at 0.5 m/s all the time
    metrics = foot_quality(feet, contacts, RADIUS, FPS)
    assert metrics["foot_skate_mean_m_s"] == pytest.approx(0.5 * 9 / 13)


def test_sinking_and_floating(feet):
    feet[3, 0, 2] -= 0.004
    feet[4, 1, 2] += 0.007
    contacts = np.ones((10, 2), bool)
    metrics = foot_quality(feet, contacts, RADIUS, FPS)
    assert metrics["ground_penetration_max_m"] == pytest.approx(0.004)
    assert metrics["stance_float_max_m"] == pytest.approx(0.007)
    assert metrics["contact_agreement"] == pytest.approx(19 / 20)


def test_an_animal_in_the_air_has_nothing_to_skate_on(feet):
    metrics = foot_quality(feet + [0, 0, 1], np.zeros((10, 2), bool), RADIUS, FPS)
    assert metrics["foot_skate_mean_m_s"] == metrics["stance_float_max_m"] == 0.0
    assert metrics["contact_agreement"] == 1.0


def test_errors_are_distances():
    targets = np.zeros((4, 5, 3))
    points = targets.copy()
    points[2, 3] = [3, 0, 4]
    metrics = keypoint_errors(points, targets)
    assert metrics["keypoint_error_max_m"] == 5.0
    assert metrics["keypoint_error_mean_m"] == pytest.approx(5 / 20)


def test_joints_at_their_limits_are_counted():
    bounds = (np.array([-1.0, -2.0]), np.array([1.0, 2.0]))
    joints = np.array([[0.0, 0.0], [0.9995, 0.1], [0.2, -2.5], [0.2, -2.5]])
    metrics = joint_quality(joints, bounds, np.array([100.0, 120.0]), FPS)
    assert metrics["joint_limit_hits"] == 3
    assert metrics["joint_speed_peak"] == pytest.approx(2.6 * FPS)
    assert metrics["joint_speed_hits"] == 1
    assert metrics["joint_jerk_peak"] > 0


def test_two_frames_have_no_jerk():
    bounds = (np.full(1, -1.0), np.full(1, 1.0))
    assert joint_quality(np.zeros((2, 1)), bounds, np.ones(1), FPS)["joint_jerk_peak"] == 0.0


def test_the_course_of_the_robot_is_compared_with_the_animals():
    time = np.arange(100) / FPS
    animal = np.stack([0.5 * time, 0 * time, 0.3 + 0 * time], axis=1)
    robot = np.stack([0.4 * time, 0 * time, 0.28 + 0 * time], axis=1)
    metrics = course_quality(robot, animal, FPS)
    assert metrics["base_speed_mean_m_s"] == pytest.approx(0.4)
    assert metrics["speed_error_mean_m_s"] == pytest.approx(0.1)
    assert metrics["height_error_mean_m"] == pytest.approx(0.02)
    assert metrics["animal_height_mean_m"] == pytest.approx(0.3)


def test_torques_beyond_the_motors_are_counted():
    share = np.full((10, 4), 0.2)
    share[3, 1] = 1.5
    metrics = effort_quality(share, np.linspace(0, 1, 10))
    assert metrics["torque_limit_hits"] == 1
    assert metrics["torque_share_peak"] == 1.5
    assert metrics["torque_share_p95"] == pytest.approx(0.2)
    assert metrics["missing_force_mean"] == pytest.approx(0.5)
