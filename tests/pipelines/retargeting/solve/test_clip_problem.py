from dataclasses import replace

import numpy as np
import pytest

from lacoloco.datasets import rotations
from lacoloco.datasets.mocap import load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.retargeting.forward_kinematics import BodyPositions
from lacoloco.pipelines.retargeting.measure.quality import foot_quality, joint_quality
from lacoloco.pipelines.retargeting.mocap.body_map import body_map, leg_geometry
from lacoloco.pipelines.retargeting.solve import clip_problem
from lacoloco.pipelines.retargeting.solve.clip_problem import ClipProblem, ClipWeights
from lacoloco.pipelines.retargeting.solve.pose_problem import PoseProblem, retarget_bounds
from lacoloco.pipelines.retargeting.targets.targets import Targets, fitted_targets
from lacoloco.robots.registry import load_robot

SPEC = load_robot("solo12")
MAP = body_map(SPEC)
LEGS = leg_geometry(SPEC, MAP)
RADIUS = SPEC.foot_radius()
POINTS = list(SPEC.keypoints.values())
POSITIONS = BodyPositions(SPEC.pinocchio_model(), POINTS)
KNEES = BodyPositions(SPEC.pinocchio_model(), SPEC.knee_frames)
FEET = BodyPositions(SPEC.pinocchio_model(), SPEC.feet)
HIPS = BodyPositions(SPEC.pinocchio_model(), [POINTS[i] for i in MAP.hip_keypoints])


@pytest.fixture(scope="module")
def problem():
    return ClipProblem(SPEC, MAP, LEGS, ClipWeights())


@pytest.fixture(scope="module")
def trot():
    """Two seconds in which the bundled dog goes over from walking to trotting."""
    return fitted_targets(load_bvh(DOG_BVH).slice(300, 420), MAP, LEGS, RADIUS)


def points_of(motion):
    return POSITIONS(motion.root_pos, motion.root_quat, motion.joint_pos)


def check(motion, targets, fps=60.0):
    """What must hold for every clip."""
    points = points_of(motion)
    feet = foot_quality(points[:, MAP.foot_keypoints], targets.contacts, RADIUS, fps)
    assert feet["foot_skate_mean_m_s"] < 1e-3
    assert feet["ground_penetration_max_m"] < 1e-3
    assert feet["stance_float_max_m"] < 1e-3
    limits = np.array(SPEC.velocity_limits)
    joints = joint_quality(motion.joint_pos, retarget_bounds(SPEC), limits, fps)
    assert joints["joint_limit_hits"] == joints["joint_speed_hits"] == 0
    knees = KNEES(motion.root_pos, motion.root_quat, motion.joint_pos)[..., 2]
    assert knees.min() > ClipWeights().knee_height - 1e-3
    return points


def test_feet_are_planted_and_keypoints_followed(problem, trot):
    motion = problem.track(trot, 60.0)
    points = check(motion, trot)
    paper = points_of(PoseProblem(SPEC).track(trot.points))
    error, papers = (np.linalg.norm(p - trot.points, axis=-1).mean() for p in (points, paper))
    assert error < papers


def test_motion_is_smoother_than_frame_by_frame(problem, trot):
    clip, paper = problem.track(trot, 60.0), PoseProblem(SPEC).track(trot.points)
    jerk = [np.abs(np.diff(motion.joint_pos, 3, axis=0)).max() for motion in (clip, paper)]
    assert jerk[0] < jerk[1]


def test_where_the_animal_looks_does_not_matter(problem, trot):
    quat = rotations.from_yaw(np.array(2.5))
    turned = replace(trot, points=rotations.rotate(quat[None, None], trot.points))
    here, there = problem.track(trot, 60.0), problem.track(turned, 60.0)
    np.testing.assert_allclose(there.joint_pos, here.joint_pos, atol=5e-3)


def test_half_the_frames_give_the_same_motion(problem, trot):
    sampled = Targets(trot.points[::2], trot.contacts[::2], trot.scale)
    fast, slow = problem.track(trot, 60.0), problem.track(sampled, 30.0)
    check(slow, sampled, 30.0)
    assert np.abs(fast.joint_pos[::2] - slow.joint_pos).mean() < 0.05


def test_120_frames_per_second(problem):
    targets = fitted_targets(load_bvh(DOG_BVH).slice(300, 361).resampled(120.0), MAP, LEGS, RADIUS)
    motion = problem.track(targets, 120.0)
    assert motion.joint_pos.shape == (121, 12) and not motion.failed.any()
    check(motion, targets, 120.0)


@pytest.mark.parametrize("frames", [2, 3, 4, 7])
def test_short_clips(problem, trot, frames):
    targets = Targets(trot.points[:frames], trot.contacts[:frames], trot.scale)
    assert problem.track(targets, 60.0).joint_pos.shape == (frames, 12)


def test_an_animal_that_sits_leaves_the_knees_above_the_ground(problem, trot):
    sitting = np.tile(trot.points[60], (60, 1, 1))
    sitting[:, MAP.foot_keypoints, 2] = RADIUS
    hips = [MAP.hip_keypoints[2], MAP.hip_keypoints[3]]
    sitting[:, hips, 2] -= np.linspace(0, 0.3, len(sitting))[:, None]
    targets = Targets(sitting, np.ones((60, 4), bool), trot.scale)
    check(problem.track(targets, 60.0), targets)


def test_speed_limits_hold_where_the_animal_is_too_fast(problem, trot):
    fast = Targets(trot.points, trot.contacts, trot.scale)
    motion = problem.track(fast, 110.0)  # the same frames in half the time
    speed = np.abs(np.diff(motion.joint_pos, axis=0)) * 110.0
    assert speed.max() < min(SPEC.velocity_limits)
    free = problem.track(fast, 60.0)
    assert np.abs(np.diff(free.joint_pos, axis=0)).max() * 110.0 > speed.max()


def test_knees_do_not_change_sides(problem, trot):
    high = trot.points.copy()
    high[:, MAP.hip_keypoints, 2] += 0.2  # out of reach: the legs would be straight
    motion = problem.track(Targets(high, trot.contacts, trot.scale), 60.0)
    assert (motion.joint_pos[:, 2::3] < -0.09).all()


def test_stretches_of_a_long_clip_join_smoothly(problem, trot, monkeypatch):
    whole = problem.track(trot, 60.0)
    monkeypatch.setattr(clip_problem, "LONGEST", 50)
    monkeypatch.setattr(clip_problem, "LOOK_AHEAD", 20)
    done = []
    parts = problem.track(trot, 60.0, done.append)
    assert done == [50, 100, 120]
    check(parts, trot)
    # Nothing beyond the last frames makes them smooth, so the cost hardly tells where they are.
    np.testing.assert_allclose(parts.joint_pos[:-2], whole.joint_pos[:-2], atol=0.05)
    np.testing.assert_allclose(parts.joint_pos, whole.joint_pos, atol=0.1)
    jerk = [np.abs(np.diff(motion.joint_pos, 3, axis=0)).max() for motion in (parts, whole)]
    assert jerk[0] < 1.2 * jerk[1]


def test_what_does_not_converge_is_made_up_counted_and_the_rest_solved(problem, trot, monkeypatch):
    solve = ClipProblem._solve

    def fragile(self, stretch, fps):
        """Fails wherever frame 70 is part of it."""
        place = np.abs(stretch.parameters - frame_70).max(1).min()
        return None if place < 1e-12 else solve(self, stretch, fps)

    frame_70 = problem._stretch(trot, 60.0).parameters[70]
    monkeypatch.setattr(ClipProblem, "_solve", fragile)
    monkeypatch.setattr(clip_problem, "SHORTEST", 30)
    monkeypatch.setattr(clip_problem, "LOOK_AHEAD", 5)
    motion = problem.track(trot, 60.0)
    assert motion.failed.tolist() == [60 <= frame < 90 for frame in range(120)]
    feet = FEET(motion.root_pos, motion.root_quat, motion.joint_pos)
    gap = feet[..., 2][trot.contacts] - RADIUS
    assert np.abs(gap).max() < 0.03  # also where nothing was solved
    assert np.abs(np.diff(motion.joint_pos, axis=0)).max() < 0.5


def lying(trot):
    """Stands, then lies down with its trunk as low as its paws."""
    frames = 90
    points = np.tile(trot.points[60], (frames, 1, 1))
    points[:, MAP.foot_keypoints, 2] = RADIUS
    down = np.clip((np.arange(frames) - 20) / 40, 0, 1)[:, None]
    points[:, MAP.hip_keypoints, 2] -= 0.25 * down
    return Targets(points, np.ones((frames, 4), bool), trot.scale)


def leaping(trot):
    """Stands, is in the air for a third of a second, stands."""
    frames = 90
    points = np.tile(trot.points[60], (frames, 1, 1))
    points[:, MAP.foot_keypoints, 2] = RADIUS
    flight = np.clip((np.arange(frames) - 35) / 20, 0, 1)
    points[..., 2] += (0.15 * 4 * flight * (1 - flight))[:, None]
    contacts = np.repeat(((flight <= 0) | (flight >= 1))[:, None], 4, axis=1)
    return Targets(points, contacts, trot.scale)


def test_an_animal_that_lies_down_lays_no_hip_into_the_ground(problem, trot):
    targets = lying(trot)
    motion = problem.track(targets, 60.0)
    assert not motion.failed.any()
    check(motion, targets)
    hips = HIPS(motion.root_pos, motion.root_quat, motion.joint_pos)
    assert hips[-20:, :, 2].max() < 0.15
    assert hips[..., 2].min() > ClipWeights().hip_height - 1e-3


def test_a_leap_stays_a_leap(problem, trot):
    targets = leaping(trot)
    motion = problem.track(targets, 60.0)
    assert not motion.failed.any()
    feet = FEET(motion.root_pos, motion.root_quat, motion.joint_pos)
    assert feet[45, :, 2].min() > RADIUS + 0.1
    assert (feet[..., 2][targets.contacts] < RADIUS + 1e-3).all()
