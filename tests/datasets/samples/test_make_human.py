"""The bundled person: the file is what the script makes, and it is a person who walks."""

import numpy as np
import pytest

from lacoloco.datasets.mocap import load_bvh
from lacoloco.datasets.samples import HUMAN_BVH, human_gait, make_human

TIMES = np.arange(601) / 60
SIDES = ("Left", "Right")


@pytest.fixture(scope="module")
def points():
    keypoints = np.swapaxes(make_human.keypoints(TIMES), 0, 1)
    return dict(zip(make_human.OFFSETS, keypoints, strict=True))


def test_reading_the_file_gives_the_analytic_points():
    mocap = load_bvh(HUMAN_BVH)
    assert mocap.fps == pytest.approx(60)
    assert mocap.duration == pytest.approx(10)
    assert mocap.joint_names == tuple(make_human.OFFSETS)
    assert np.abs(mocap.positions - make_human.keypoints(TIMES)).max() <= 1e-6


def test_the_bundled_file_is_what_the_script_makes(tmp_path):
    new = make_human.make(tmp_path / "person.bvh").read_text()
    old = HUMAN_BVH.read_text()
    assert new.split("MOTION")[0] == old.split("MOTION")[0]
    rows = [np.loadtxt(t.splitlines()[-601:]) for t in (new, old)]
    np.testing.assert_allclose(rows[0], rows[1], atol=2e-5)  # the last digit may round differently


def test_joints_may_have_other_names(tmp_path):
    path = make_human.make(tmp_path / "p.bvh", rename={"LeftToeBase": "LeftToe"})
    mocap = load_bvh(path)
    assert "LeftToe" in mocap.joint_names and "LeftToe_end" in mocap.joint_names
    np.testing.assert_array_equal(mocap.positions, load_bvh(HUMAN_BVH).positions)


@pytest.mark.parametrize("side", SIDES)
def test_feet_do_not_move_while_they_stand_and_never_sink(points, side):
    heel_stands, ball_stands = human_gait.stance(side, TIMES)
    foot = human_gait.foot(side, TIMES)
    forward = np.column_stack([np.cos(foot.yaw), np.sin(foot.yaw)])
    back = np.cos(foot.pitch) * -human_gait.HEEL + np.sin(foot.pitch) * human_gait.ANKLE
    down = np.sin(foot.pitch) * -human_gait.HEEL - np.cos(foot.pitch) * human_gait.ANKLE
    heel = foot.ankle + np.column_stack([forward * back[:, None], down])
    ball = points[f"{side}ToeBase"]
    for point, stands, height in ((heel, heel_stands, 0.0), (ball, ball_stands, 0.02)):
        step = np.linalg.norm(np.diff(point, axis=0), axis=1)
        assert step[stands[1:] & stands[:-1]].max() < 1e-12
        assert point[:, 2].min() >= height - 1e-12
    assert 0.55 < (heel_stands | ball_stands).mean() < 0.7
    assert (heel_stands & ball_stands).mean() > 0.2


def test_a_foot_stands_at_all_times_and_the_feet_alternate():
    standing = [np.any(human_gait.stance(side, TIMES), axis=0) for side in SIDES]
    assert np.any(standing, axis=0).all()
    strikes = [(time, side) for side in SIDES for time in human_gait.heel_strikes(side)]
    sides = [side for _, side in sorted(strikes)]
    assert all(a != b for a, b in zip(sides[:-1], sides[1:], strict=True))


def test_the_person_walks_upright_and_turns_left(points):
    speed = np.linalg.norm(np.gradient(points["Hips"][:, :2], 1 / 60, axis=0), axis=1)
    assert speed.mean() == pytest.approx(human_gait.SPEED, rel=0.02)
    assert (points["Neck"][:, 2] - points["Hips"][:, 2]).min() > 0.4
    left = [points["LeftUpLeg"][k, :2] - points["RightUpLeg"][k, :2] for k in (0, -1)]
    turn = np.arctan2(left[0][0] * left[1][1] - left[0][1] * left[1][0], left[0] @ left[1])
    assert np.degrees(turn) == pytest.approx(90, abs=10)


def test_knees_and_elbows_bend_forward_and_arms_swing_against_the_legs(points):
    angle = human_gait.heading(TIMES)
    forward = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    for side in SIDES:
        for top, joint, bottom, sign in (
            ("UpLeg", "Leg", "Foot", 1),
            ("Arm", "ForeArm", "Hand", -1),
        ):
            middle = 0.5 * (points[side + top] + points[side + bottom])
            bend = ((points[side + joint] - middle) * forward).sum(1)
            assert (sign * bend > 0.01).all()
        hand = ((points[side + "Hand"] - points[side + "Arm"]) * forward).sum(1)
        foot = ((points[side + "Foot"] - points[side + "UpLeg"]) * forward).sum(1)
        assert np.corrcoef(hand, foot)[0, 1] < -0.8


def test_nothing_jumps(points):
    for name, point in points.items():
        acceleration = np.linalg.norm(np.diff(point, 2, axis=0), axis=1) * 3600
        assert acceleration.max() < 65, name
