import numpy as np
import pytest

from lacoloco.datasets import rotations
from lacoloco.datasets.mocap import load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.forward_kinematics import BodyPositions
from lacoloco.pipelines.retargeting.solve.pose_problem import (
    PoseProblem,
    pose_program,
    retarget_bounds,
)
from lacoloco.pipelines.retargeting.solve.solver import COLD, Solver
from lacoloco.robots.registry import load_robot

SPEC = load_robot("solo12")


@pytest.fixture(scope="module")
def problem():
    return PoseProblem(SPEC)


@pytest.fixture(scope="module")
def positions():
    return BodyPositions(SPEC.pinocchio_model(), list(SPEC.keypoints.values()))


@pytest.fixture(scope="module")
def dog():
    return load_bvh(DOG_BVH).keypoints(list(SPEC.keypoints))


def poses(frames, turn=0.0, seed=0):
    """A smooth motion of the robot itself, with knees bent as in the neutral pose."""
    phase = np.linspace(0, 2 * np.pi, frames)[:, None] + np.arange(12)
    joints = np.array(SPEC.retarget_neutral) + 0.3 * np.sin(phase)
    position = np.stack([phase[:, 0] / 6, 0 * phase[:, 0], np.full(frames, 0.4)], axis=1)
    return position, rotations.from_yaw(np.linspace(0, turn, frames)), joints


def test_without_a_posture_cost_a_motion_of_the_robot_is_found_exactly(positions):
    motion = poses(60, turn=1.0)
    found = PoseProblem(SPEC, posture_weight=0.0).track(positions(*motion))
    np.testing.assert_allclose(found.root_pos, motion[0], atol=1e-4)
    np.testing.assert_allclose(found.joint_pos, motion[2], atol=1e-3)
    assert not found.failed.any()


def test_an_animal_that_turns_around_twice_meets_no_singularity(problem, positions):
    position, quat, joints = poses(300, turn=4 * np.pi)
    found = problem.track(positions(position, quat, joints))
    assert not found.failed.any()
    assert (
        np.abs(
            rotations.log_map(rotations.multiply(rotations.conjugate(quat), found.root_quat))
        ).max()
        < 0.2
    )
    assert found.cost.max() < 0.05


def test_the_cost_does_not_depend_on_where_the_animal_looks(problem, dog):
    frames = dog[100:160]
    turn = rotations.from_yaw(np.array(2.2))
    turned = rotations.rotate(turn[None, None], frames)
    np.testing.assert_allclose(problem.track(turned).cost, problem.track(frames).cost, atol=1e-6)


def test_limits_and_knees_hold_on_the_dog(problem, dog):
    found = problem.track(dog[::4])
    lower, upper = retarget_bounds(SPEC)
    assert (found.joint_pos >= lower - 1e-6).all()
    assert (found.joint_pos <= upper + 1e-6).all()
    knees = BodyPositions(SPEC.pinocchio_model(), SPEC.knee_frames)
    heights = knees(found.root_pos, found.root_quat, found.joint_pos)[..., 2]
    assert heights.min() > -1e-6


def test_targets_below_the_ground_leave_the_knees_above_it(problem, dog):
    found = problem.track(dog[:20] - [0, 0, 0.5])
    knees = BodyPositions(SPEC.pinocchio_model(), SPEC.knee_frames)
    heights = knees(found.root_pos, found.root_quat, found.joint_pos)[..., 2]
    assert heights.min() > -1e-6
    assert heights.min() < 1e-3


def test_bounds_are_within_the_model(problem):
    lower, upper = retarget_bounds(SPEC)
    model_lower, model_upper = SPEC.joint_limits()
    assert (lower >= model_lower).all()
    assert (upper <= model_upper).all()


@pytest.mark.parametrize("frame", range(0, 700, 100))
def test_no_cold_start_finds_a_better_pose(problem, dog, frame):
    warm = problem.track(dog[max(frame - 20, 0) : frame + 1]).cost[-1]
    solver = Solver(pose_program(SPEC, 0.005), COLD)
    center = dog[frame].mean(0)
    rng = np.random.default_rng(frame)
    lower, upper = retarget_bounds(SPEC)
    for heading in np.linspace(0, 2 * np.pi, 4, endpoint=False):
        joints = np.clip(SPEC.retarget_neutral + rng.normal(0, 0.5, 12), lower, upper)
        quat = rotations.from_yaw(np.array(heading))
        guess = np.concatenate([center, np.zeros(3), joints])
        other = solver.solve(guess, np.concatenate([quat, dog[frame].ravel()]))
        assert other is None or warm <= other.cost + 1e-6


def test_a_frame_that_cannot_be_solved_is_blended_and_counted(problem, dog, monkeypatch):
    whole = problem.track(dog[:30])
    solve = PoseProblem._solve
    calls = iter(range(30))
    monkeypatch.setattr(
        PoseProblem, "_solve", lambda *args: None if next(calls) in (10, 11) else solve(*args)
    )
    found = problem.track(dog[:30])
    assert found.failed.tolist() == [index in (10, 11) for index in range(30)]
    np.testing.assert_allclose(found.joint_pos, whole.joint_pos, atol=0.05)
    np.testing.assert_allclose(np.linalg.norm(found.root_quat, axis=1), 1.0)


def test_a_failure_at_the_ends_takes_the_nearest_pose(problem, dog, monkeypatch):
    solve = PoseProblem._solve
    calls = iter(range(5))
    monkeypatch.setattr(
        PoseProblem, "_solve", lambda *args: None if next(calls) in (0, 4) else solve(*args)
    )
    found = problem.track(dog[:5])
    np.testing.assert_array_equal(found.joint_pos[0], found.joint_pos[1])
    np.testing.assert_array_equal(found.root_quat[4], found.root_quat[3])


def test_nothing_solved_is_an_error(problem, dog, monkeypatch):
    monkeypatch.setattr(PoseProblem, "_solve", lambda *args: None)
    with pytest.raises(StageError, match="no pose in any frame"):
        problem.track(dog[:3])


def test_a_robot_without_keypoints_is_named():
    with pytest.raises(StageError, match="h1.*keypoints"):
        PoseProblem(load_robot("h1"))


def test_an_infeasible_program_is_no_solution():
    program = pose_program(SPEC, 0.005)
    impossible = (np.full(4, 10.0), np.full(4, 9.0))
    from dataclasses import replace

    solver = Solver(replace(program, constraint_bounds=impossible), COLD)
    assert solver.solve(np.zeros(18), np.concatenate([[1, 0, 0, 0], np.zeros(24)])) is None
