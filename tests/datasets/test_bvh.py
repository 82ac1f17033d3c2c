"""What other programs write: each variant of the sample dog reads as the sample itself."""

import re

import numpy as np
import pytest

from lacoloco.datasets.bvh import parse_bvh
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import read_bvh
from lacoloco.datasets.samples import DOG_BVH

BASE = DOG_BVH.read_text()
HEAD, MOTION = BASE.split("MOTION")
ROWS = MOTION.split("\n", 3)[3]
ROOT = "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
JOINT = "CHANNELS 3 Zrotation Xrotation Yrotation"


@pytest.fixture
def read(tmp_path):
    def read(content, name="dog.bvh"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_bvh(path)

    return read


def positions_on_all_joints():
    """The same motion with the OFFSET of every joint written into position channels."""
    offsets = re.findall(r"OFFSET (\S+ \S+ \S+)\s+CHANNELS 3", HEAD)
    rows = []
    for row in ROWS.splitlines():
        numbers = row.split()
        joints = [numbers[6 + 3 * k : 9 + 3 * k] for k in range(len(offsets))]
        pairs = zip(offsets, joints, strict=True)
        rows.append(" ".join([*numbers[:6], *(word for o, j in pairs for word in (o, *j))]))
    return HEAD.replace(JOINT, ROOT) + "MOTION" + "\n".join([*MOTION.split("\n")[:3], *rows, ""])


def other_root_order():
    """Root positions in the order z, y, x."""
    rows = [row.split(" ", 3) for row in ROWS.splitlines()]
    turned = "\n".join(" ".join([z, y, x, rest]) for x, y, z, rest in rows)
    head = HEAD.replace("Xposition Yposition Zposition", "Zposition Yposition Xposition")
    return BASE.replace(HEAD, head).replace(ROWS.rstrip("\n"), turned)


def wrapped_rows():
    """Rows of twenty numbers on a line."""
    words = ROWS.split()
    lines = [" ".join(words[k : k + 20]) for k in range(0, len(words), 20)]
    return BASE.replace(ROWS, "\n".join(lines) + "\n")


def lower_case():
    words = "HIERARCHY|ROOT|JOINT|End Site|OFFSET|CHANNELS|MOTION"
    return re.sub(rf"\b({words})\b", lambda match: match[0].lower(), BASE)


VARIANTS = {
    "positions on all joints": positions_on_all_joints(),
    "other order of root positions": other_root_order(),
    "wrapped rows": wrapped_rows(),
    "lower-case keywords": lower_case(),
    "comments on top": "# exported by a tool\n// and another\n\n" + BASE,
    "END SITE": BASE.replace("End Site", "END SITE"),
    "no space after Frames:": re.sub(r"(Frames|Frame Time):\s+", r"\1:", BASE),
    "braces on one line": re.sub(r"\}\s+\}", "} }", re.sub(r"\s+\{", " {", HEAD))
    + "MOTION"
    + MOTION,
    "end-of-file mark": BASE + "\x1a",
    "UTF-16": BASE.encode("utf-16"),
    "UTF-8 with a mark": BASE.encode("utf-8-sig"),
    "windows lines": BASE.replace("\n", "\r\n"),
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_variants_read_as_the_sample(read, variant):
    expected, found = read_bvh(DOG_BVH), read(VARIANTS[variant])
    np.testing.assert_array_equal(found.positions, expected.positions)
    assert (found.joint_names, found.parents, found.remarks) == (
        expected.joint_names,
        expected.parents,
        (),
    )


def test_suffix_in_capitals(read):
    assert read(BASE, "DOG.BVH").frames == read_bvh(DOG_BVH).frames


def test_names_with_spaces_and_of_other_encodings(read):
    names = read(BASE.replace("JOINT Tail1", "JOINT Tail \xe9").encode("latin-1")).joint_names
    assert "Tail \xe9" in names
    assert "Tail \xe9_end" in names


@pytest.mark.parametrize("off", [-1, 1])
def test_a_frame_count_that_is_off_by_one_is_said_and_taken(read, off):
    frames = read_bvh(DOG_BVH).frames
    found = read(re.sub(r"Frames:\s*\d+", f"Frames: {frames + off}", BASE))
    assert found.frames == frames
    assert found.remarks == (
        f"declares {frames + off} frames and holds {frames}: all {frames} are taken",
    )


SLIDER = """HIERARCHY
ROOT Base
{
  OFFSET 1 2 3
  CHANNELS 1 Yposition
  JOINT Arm
  {
    OFFSET 10 0 0
    CHANNELS 2 Xposition Zrotation
    JOINT Fixed
    {
      OFFSET 1 0 0
      CHANNELS 0
      End Site
      {
        OFFSET 0 1 0
      }
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.02
0 10 0
5 12 90
"""


def test_any_number_of_channels_by_hand(read):
    """Position channels replace the OFFSET along their axes, at the root and elsewhere."""
    mocap = read(SLIDER)
    assert mocap.joint_names == ("Base", "Arm", "Fixed", "Fixed_end")
    first = [[1, 0, 3], [11, 0, 3], [12, 0, 3], [12, 1, 3]]
    second = [[1, 5, 3], [13, 5, 3], [13, 6, 3], [12, 6, 3]]
    np.testing.assert_allclose(mocap.positions, [first, second], atol=1e-12)


def test_frame_times_that_are_cut_off_are_rates_of_whole_frames(tmp_path):
    path = tmp_path / "a.bvh"
    for text, fps in (("0.033333", 30), ("0.0166667", 60), ("0.041708", 1 / 0.041708)):
        path.write_text(SLIDER.replace("0.02", text))
        assert 1.0 / parse_bvh(path).frame_time == pytest.approx(fps, rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("5 12 90", "5 12,5 90", "line 25: '12,5' is no number; write numbers with a point"),
        ("0.02", "0,02", "write numbers with a point"),
        ("5 12 90", "5 12", "last row has 2 of 3 numbers"),
        ("Frames: 2", "Frames: 2.5", "no whole number"),
        ("Frames: 2", "Frames: many", "no whole number"),
        ("Frames: 2", "Frames: 7", "declares 7 frames but holds 2"),
        ("JOINT Fixed", "JOINT Arm", "line 10: two joints have the same name 'Arm'"),
        ("JOINT Fixed", "JOINT", "line 10: a JOINT has no name"),
        ("OFFSET 10 0 0", "OFFSET 10 0", "line 8: OFFSET 10 0: three numbers"),
        ("OFFSET 10 0 0", "OFFSET 10,5 0 0", "three numbers are needed; write numbers with a p"),
        ("OFFSET 10 0 0\n", "\n", "'Arm' has no OFFSET"),
        ("CHANNELS 0", "CHANNELS 1 Wrotation", "line 13: CHANNELS 1 Wrotation"),
        ("CHANNELS 0", "CHANNELS 2 Xrotation", "line 13: CHANNELS 2 Xrotation"),
        ("JOINT Arm", "ROOT Arm", "lies within another joint"),
        ("}\n}\nMOTION", "}\nMOTION", "a brace is not closed"),
        ("}\nMOTION", "}\n}\nMOTION", "a brace closes that was never opened"),
        ("ROOT Base", "JOINT Base", "one ROOT"),
        ("CHANNELS 0", "CHANNEL 0", "line 13: 'CHANNEL 0' has no place here"),
    ],
)
def test_a_bad_line_is_named(read, old, new, words):
    assert old in SLIDER
    with pytest.raises(DatasetError, match=re.escape(words)) as caught:
        read(SLIDER.replace(old, new))
    assert "\n" not in str(caught.value)


def test_a_file_without_channels_moves_nothing(read):
    text = re.sub(r"CHANNELS .*", "CHANNELS 0", SLIDER)
    with pytest.raises(DatasetError, match="nothing moves"):
        read(text)


SAME = (
    "UPPER.BVH",
    "braces_sp_joined",
    "ctrl_z",
    "endsite_upper",
    "frames_minus1",
    "frames_nospace",
)
SAME += ("frames_plus1", "header_comment", "latin1", "lower_keywords", "names_space", "pos_all")
SAME += ("root_pos_zyx", "wrapped_rows")


@pytest.mark.parametrize("case", SAME)
def test_cases_that_were_refused_read_as_their_base(shared, case):
    folder = shared / "cases" / "bvh"
    expected = read_bvh(folder / "base.bvh").positions
    found = read_bvh(folder / (case if "." in case else f"{case}.bvh"))
    np.testing.assert_array_equal(found.positions, expected)


def test_a_reference_above_the_root_adds_a_node_only(shared):
    folder = shared / "cases" / "bvh"
    found = read_bvh(folder / "reference_root_6ch.bvh").positions[:, 1:]
    np.testing.assert_array_equal(found, read_bvh(folder / "base.bvh").positions)


@pytest.mark.parametrize(
    ("case", "words"),
    [
        ("comma_dec_motion", "write numbers with a point"),
        ("cut_mid_row", "last row has 44 of 66"),
        ("dup_names", "the same name 'Tail'"),
        ("ft_nan", "Frame Time: 'nan'"),
    ],
)
def test_cases_that_stay_refused_say_why(shared, case, words):
    with pytest.raises(DatasetError, match=re.escape(words)):
        read_bvh(shared / "cases" / "bvh" / f"{case}.bvh")
