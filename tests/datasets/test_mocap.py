import re
from dataclasses import replace

import numpy as np
import pytest

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import load_bvh, read_bvh
from lacoloco.datasets.samples import DOG_BVH, make_dog

SMALL = """HIERARCHY
ROOT Hips
{
  OFFSET 500 600 700
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Leg
  {
    OFFSET 10 0 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 -20 0
    }
  }
}
MOTION
Frames:\t2
Frame Time:\t0.02
1 2 3 0 0 0 0 0 0
1 2 3 90 0 0 0 90 0
"""


@pytest.fixture
def bvh(tmp_path):
    def write(text=SMALL, name="small.bvh"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def test_points_by_hand_y_up(bvh):
    """World (x, y, z) = (-x, z, y) / 100 of the file; the root's OFFSET is not added."""
    mocap = load_bvh(bvh())
    assert (mocap.name, mocap.frames) == ("small", 2)
    assert (mocap.fps, mocap.duration) == (pytest.approx(50), pytest.approx(0.02))
    assert mocap.joint_names == ("Hips", "Leg", "Leg_end")
    assert mocap.parents == (-1, 0, 1)
    first = [[-0.01, 0.03, 0.02], [-0.11, 0.03, 0.02], [-0.11, 0.03, -0.18]]
    # Turned by 90 deg about z, the leg points up in the file; its end, about x too, along z.
    second = [[-0.01, 0.03, 0.02], [-0.01, 0.03, 0.12], [-0.01, -0.17, 0.12]]
    np.testing.assert_allclose(mocap.positions, [first, second], atol=1e-12)


def test_other_axes_and_units(bvh):
    mocap = load_bvh(bvh(), up_axis="z", scale=1.0)
    np.testing.assert_allclose(mocap.positions[0, 1], [11, 2, 3], atol=1e-12)
    with pytest.raises(DatasetError, match="up_axis 'w'"):
        load_bvh(bvh(), up_axis="w")
    with pytest.raises(DatasetError, match="scale 0"):
        load_bvh(bvh(), scale=0)


def test_variants_of_the_same_file_read_the_same(bvh):
    expected = load_bvh(bvh()).positions
    variants = [
        SMALL.replace("\n", "\r\n"),
        SMALL.replace("  ", "\t"),
        SMALL.replace("\t", " "),
        SMALL + "\n\n",
        SMALL.replace("OFFSET 500 600 700", "OFFSET 0 0 0"),
    ]
    for text in variants:
        np.testing.assert_array_equal(load_bvh(bvh(text)).positions, expected)


def test_keypoints_and_slices(bvh):
    mocap = load_bvh(bvh())
    np.testing.assert_array_equal(mocap.keypoints(["Leg_end"])[:, 0], mocap.positions[:, 2])
    with pytest.raises(DatasetError, match="no joint 'leg'.*did you mean 'Leg'"):
        mocap.keypoints(["Hips", "leg"])
    part = mocap.slice(1, 2)
    np.testing.assert_array_equal(part.positions, mocap.positions[1:])
    with pytest.raises(DatasetError, match="0:3 are not within 0:2"):
        mocap.slice(0, 3)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b" \n\n", "empty"),
        (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", "not a BVH file"),
        (b"frame,x,y,z\n0,1,2,3\n", "not a BVH file"),
        (b"HIERARCHY\n\xff\xfe\x00\x01", "no line MOTION"),
        (SMALL.split("MOTION")[0], "no line MOTION"),
        (SMALL[:120], "cut short"),
        (SMALL.rsplit(" ", 8)[0], "cut short"),
        (SMALL.rsplit(" ", 2)[0], "last row has 7 of 9"),
        (SMALL.replace("Frames:\t2", "Frames:\t0"), "zero"),
        (SMALL.replace("Frames:\t2", "Frames:\t0").rsplit("\n", 3)[0] + "\n", "zero"),
        (SMALL.replace("Frames:\t2", "Frames:\t4"), "declares 4 frames but holds 2"),
        (SMALL.replace("0.02\n", "0\n"), "Frame Time: '0'"),
        (SMALL.replace("0.02\n", "-0.02\n"), "Frame Time: '-0.02'"),
        (SMALL.replace("0.02\n", "nan\n"), "Frame Time: 'nan'"),
        (SMALL.replace("90 0 0 0 90", "nan 0 0 0 90"), "frame 1 holds a value"),
        (SMALL.replace("90 0 0 0 90", "inf 0 0 0 90"), "frame 1 holds a value"),
        (SMALL.replace("1 2 3 90", "1e30 2 3 90"), "frame 1 holds a value"),
        (SMALL.replace("1 2 3 90", "1 2 x 90"), "line 20: 'x' is no number"),
        (SMALL.replace("JOINT Leg", "JOINT Hips"), "same name 'Hips'"),
        (
            SMALL.replace("CHANNELS 3", "CHANNELS 6 Xposition Yposition Zposition"),
            "6 of 12 numbers",
        ),
    ],
)
def test_bad_files_give_one_line_that_names_them(bvh, content, words):
    path = bvh(content)
    with pytest.raises(DatasetError, match=words) as caught:
        load_bvh(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert message.count(str(path)) == 1


def test_missing_file_and_directory(tmp_path):
    with pytest.raises(DatasetError, match="no such file"):
        load_bvh(tmp_path / "none.bvh")
    with pytest.raises(DatasetError, match="is a directory"):
        load_bvh(tmp_path)


def test_any_truncation_is_refused_or_loses_digits_of_the_last_number_only(bvh):
    content = DOG_BVH.read_bytes()[: 1 << 13].rsplit(b"\n", 1)[0]
    rows = content.split(b"MOTION")[1].count(b"\n") - 2
    content = re.sub(rb"Frames:\t\d+", b"Frames:\t%d" % rows, content)
    whole = load_bvh(bvh(content)).positions
    for end in range(0, len(content) - 12, 41):
        with pytest.raises(DatasetError):
            load_bvh(bvh(content[:end]))
    assert whole.shape == (rows, 27, 3)


@pytest.mark.parametrize(
    ("clip", "published"),
    [("D1_010_KAN01_002", "dog_run01"), ("D1_009_KAN01_001", "dog_walk03")],
)
def test_recorded_dog_equals_its_published_keypoints(shared, clip, published):
    """Independent forward kinematics of the same recordings (m, y up, first frame at x = z = 0)."""
    folder = shared / "data" / "mocap"
    mocap = load_bvh(folder / "bvh" / f"{clip}.bvh")
    text = (folder / "keypoints" / f"{published}_joint_pos.txt").read_text().replace(",", " ")
    points = np.array([line.split() for line in text.splitlines()], dtype=float)
    points = points.reshape(len(points), 27, 3)
    expected = np.stack([-points[..., 0], points[..., 2], points[..., 1]], axis=-1)
    ours = mocap.positions - mocap.positions[0, 0] * [1, 1, 0]
    expected = expected - expected[0, 0] * [1, 1, 0]
    assert ours.shape == expected.shape
    assert np.abs(ours - expected).max() < 1e-5


def test_every_recorded_clip_is_upright_and_left_is_left(shared):
    for path in sorted((shared / "data" / "mocap" / "bvh").glob("D1_*.bvh")):
        mocap = load_bvh(path)
        hips, neck, left, right = np.swapaxes(
            mocap.keypoints(["Hips", "Neck", "LeftUpLeg", "RightUpLeg"]), 0, 1
        )
        assert 0.4 < hips[:, 2].max() < 0.7, path.name  # D1_031 also lies down
        forward, side = neck - hips, left - right
        upward = np.cross(forward, side)[:, 2]
        assert np.median(upward) > 0, path.name


def test_another_channel_order_and_rate(shared):
    mocap = load_bvh(shared / "data" / "mocap" / "bvh" / "Dog_example_zyx_30fps.bvh")
    assert (mocap.frames, mocap.fps) == (494, pytest.approx(30))
    lengths = np.linalg.norm(np.diff(mocap.keypoints(["LeftLeg", "LeftFoot"]), axis=1), axis=-1)
    np.testing.assert_allclose(lengths, 0.18, atol=1e-6)


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_whichever_axis_is_up_a_left_hand_stays_a_left_hand(bvh, up):
    raw, placed = read_bvh(bvh()), load_bvh(bvh(), up_axis=up, scale=1.0)
    axis, sign = "xyz".index(up[-1]), -1 if up[0] == "-" else 1
    np.testing.assert_allclose(placed.positions[..., 2], sign * raw.positions[..., axis])
    # a proper rotation is a combination of the axes with determinant 1
    points = np.random.default_rng(0).normal(size=(1, 3, 3))
    turned = replace(raw, positions=points).placed(up, 1.0).positions
    assert np.linalg.det(turned[0]) == pytest.approx(np.linalg.det(points[0]))


def test_another_rate_keeps_the_motion():
    mocap = load_bvh(DOG_BVH)
    twice = mocap.resampled(120.0)
    assert (twice.frames, twice.fps) == (2 * mocap.frames - 1, 120.0)
    np.testing.assert_allclose(twice.positions[::2], mocap.positions, atol=1e-12)
    between = make_dog.keypoints(np.arange(1, 2 * mocap.frames - 1, 2) / 120)
    assert np.abs(twice.positions[1::2] - between).max() < 2e-3
    half = mocap.resampled(30.0)
    np.testing.assert_allclose(half.positions, mocap.positions[::2], atol=1e-4)
    with pytest.raises(DatasetError, match="resample to 0"):
        mocap.resampled(0)


def test_a_mirror_image_turns_the_other_way_and_keeps_its_names():
    mocap = load_bvh(DOG_BVH)
    pairs = [("LeftHand", "RightHand"), ("LeftFoot", "RightFoot")]
    image = mocap.mirrored(pairs)
    np.testing.assert_array_equal(
        image.keypoints(["LeftHand"]), mocap.keypoints(["RightHand"]) * [1, -1, 1]
    )
    np.testing.assert_array_equal(image.keypoints(["Head"]), mocap.keypoints(["Head"]) * [1, -1, 1])
    np.testing.assert_array_equal(image.mirrored(pairs).positions, mocap.positions)
