"""The bundled dog: the file is what the script makes, and the script makes a dog that walks."""

import re

import numpy as np
import pytest

from lacoloco.datasets.mocap import load_bvh
from lacoloco.datasets.samples import DOG_BVH, gait, make_dog, skeleton

TIMES = np.arange(721) / 60
WALK = (TIMES > 0.5) & (TIMES < 3.0)
TROT = (TIMES > 5.0) & (TIMES < 7.0)


@pytest.fixture(scope="module")
def points():
    return dict(zip(skeleton.OFFSETS, np.swapaxes(make_dog.keypoints(TIMES), 0, 1), strict=True))


def test_reading_the_file_gives_the_analytic_points():
    mocap = load_bvh(DOG_BVH)
    assert mocap.fps == pytest.approx(60)
    assert mocap.duration == pytest.approx(12)
    assert mocap.joint_names == tuple(skeleton.OFFSETS)
    assert np.abs(mocap.positions - make_dog.keypoints(TIMES)).max() <= 1e-6


def test_the_bundled_file_is_what_the_script_makes(tmp_path):
    new = make_dog.make(tmp_path / "dog.bvh").read_text()
    old = DOG_BVH.read_text()
    assert new.split("MOTION")[0] == old.split("MOTION")[0]
    rows = [np.loadtxt(t.splitlines()[-721:]) for t in (new, old)]
    np.testing.assert_allclose(rows[0], rows[1], atol=2e-5)  # the last digit may round differently


def test_crlf_variant_reads_the_same(tmp_path):
    path = make_dog.make(tmp_path / "dog.bvh", newline="\r\n")
    assert b"\r\n" in path.read_bytes()
    np.testing.assert_array_equal(load_bvh(path).positions, load_bvh(DOG_BVH).positions)


def test_layout_is_that_of_the_recordings(shared):
    """Same lines with the same names; only the numbers are our own."""

    def outline(path):
        header = path.read_text().split("Frame Time")[0]
        return re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "N", header.replace("Frames:\t", "Frames:<TAB>"))

    recorded = shared / "data" / "mocap" / "bvh" / "D1_010_KAN01_002.bvh"
    assert outline(DOG_BVH) == outline(recorded)


def test_paws_do_not_move_while_they_stand(points):
    for end, standing in make_dog.stance(TIMES).items():
        assert 0.4 < standing.mean() < 0.7
        both = standing[1:] & standing[:-1]
        step = np.linalg.norm(np.diff(points[end], axis=0), axis=1)
        changed = step[both] > 1e-12
        # Two frames that both stand may lie in different stances, around a very short swing.
        assert not changed.any()
        assert points[end][:, 2].min() >= 0.03 - 1e-12
        assert step.max() * 60 < 5.0


def footfall_order(window):
    standing = make_dog.stance(TIMES)
    falls = []
    for end, on in standing.items():
        down = np.flatnonzero(~on[:-1] & on[1:] & window[1:])
        falls += [(index, end) for index in down]
    return [f"{end[0]}{'F' if 'Hand' in end else 'H'}" for _, end in sorted(falls)]


def test_the_walk_has_a_lateral_sequence_and_the_trot_diagonal_pairs():
    walk = "".join(footfall_order(WALK))
    assert "LHLFRHRFLHLFRHRF" in walk
    standing = make_dog.stance(TIMES)
    np.testing.assert_array_equal(standing["LeftHand_end"][TROT], standing["RightFoot_end"][TROT])
    np.testing.assert_array_equal(standing["RightHand_end"][TROT], standing["LeftFoot_end"][TROT])
    count = np.sum(list(standing.values()), axis=0)
    assert count[WALK].min() >= 2
    assert count[TROT].min() == 0


def test_the_trot_is_faster_than_the_walk_and_the_turn_goes_left(points):
    velocity = np.gradient(points["Hips"][:, :2], 1 / 60, axis=0)
    speed = np.linalg.norm(velocity, axis=1)
    assert speed[WALK].mean() == pytest.approx(gait.WALK.speed, rel=0.02)
    assert speed[TROT].mean() == pytest.approx(gait.TROT.speed, rel=0.02)
    start, end = (points["Neck"][k, :2] - points["Hips"][k, :2] for k in (300, -1))
    turn = np.arctan2(start[0] * end[1] - start[1] * end[0], start @ end)
    assert np.degrees(turn) == pytest.approx(90, abs=3)


def test_knees_bend_forward_and_elbows_backward(points):
    forward = points["Neck"] - points["Hips"]
    for side in ("Left", "Right"):
        for top, joint, bottom, sign in (
            ("UpLeg", "Leg", "Foot", 1),
            ("Arm", "ForeArm", "Hand", -1),
        ):
            middle = 0.5 * (points[side + top] + points[side + bottom])
            bend = ((points[side + joint] - middle) * forward).sum(1)
            assert (sign * bend > 0).all()
        assert (points[f"{side}Leg"][:, 2] > points[f"{side}Foot"][:, 2]).all()


def test_the_body_is_upright_and_left_is_left(points):
    side = points["LeftUpLeg"] - points["RightUpLeg"]
    up = np.cross(points["Neck"] - points["Hips"], side)
    assert (up[:, 2] > 0).all()
    assert 0.42 < points["Hips"][:, 2].min() < points["Hips"][:, 2].max() < 0.47


def test_nothing_jumps(points):
    for name, point in points.items():
        acceleration = np.linalg.norm(np.diff(point, 2, axis=0), axis=1) * 3600
        assert acceleration.max() < (80 if "Left" in name or "Right" in name else 15), name


def test_a_speed_that_the_legs_cannot_follow_is_refused(monkeypatch):
    fast = gait.Gait(3.0, 1.4, 0.62, gait.WALK.lags)
    monkeypatch.setattr(gait, "WALK", fast)
    with pytest.raises(ValueError, match="would have to be straight"):
        make_dog.keypoints(TIMES)
