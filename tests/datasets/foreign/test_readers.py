import io
import json
import pickle
import zipfile

import numpy as np
import pytest

from lacoloco.datasets import rotations
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.foreign.reading import read_motion
from lacoloco.datasets.foreign.tables import LAFAN_JOINTS

FRAMES = 12
POS = np.cumsum(np.full((FRAMES, 3), [0.01, 0.0, 0.001]), axis=0)
WXYZ = rotations.exp_map(np.linspace([0.0, 0.1, 0.0], [0.1, 0.0, 0.8], FRAMES))
XYZW = WXYZ[:, [1, 2, 3, 0]]
JOINTS = np.sin(np.arange(FRAMES)[:, None] / 5 + np.arange(12))


def test_a_pickle_of_gmr(tmp_path):
    content = {"fps": 30, "root_pos": POS, "root_rot": XYZW, "dof_pos": JOINTS}
    content |= {"local_body_pos": None, "link_body_list": None}
    path = tmp_path / "walk.pkl"
    path.write_bytes(pickle.dumps(content))
    motion = read_motion(path)
    assert (motion.name, motion.kind, motion.fps) == ("walk", "GMR pickle", 30.0)
    assert (motion.quat_order, motion.joint_order, motion.joint_names) == ("xyzw", "model", None)
    assert np.array_equal(motion.root_quat, XYZW) and np.array_equal(motion.joint_pos, JOINTS)


def test_a_pickle_of_mimickit(tmp_path):
    frames = np.hstack([POS, rotations.log_map(WXYZ), JOINTS])
    path = tmp_path / "walk.pkl"
    path.write_bytes(pickle.dumps({"loop_mode": 0, "fps": 60, "frames": frames.tolist()}))
    motion = read_motion(path)
    assert (motion.fps, motion.quat_order, motion.joint_order) == (60.0, "wxyz", "model")
    np.testing.assert_allclose(motion.root_quat, WXYZ, atol=1e-12)
    np.testing.assert_array_equal(motion.root_pos, POS)
    np.testing.assert_array_equal(motion.joint_pos, JOINTS)


def test_an_npz_of_mjlab_or_beyondmimic(tmp_path):
    path = tmp_path / "walk.npz"
    arrays = {
        "fps": np.array([50]),
        "joint_pos": JOINTS,
        "joint_vel": JOINTS,
        "body_pos_w": np.stack([POS, POS + 1.0], axis=1),
        "body_quat_w": np.stack([WXYZ, WXYZ[::-1]], axis=1),
    }
    np.savez(path, **arrays)
    motion = read_motion(path)
    assert (motion.fps, motion.quat_order) == (50.0, "wxyz")
    assert (motion.joint_order, motion.joint_names) == (None, None)
    assert np.array_equal(motion.root_pos, POS) and np.array_equal(motion.root_quat, WXYZ)
    np.savez(path, **arrays, joint_names=np.array([f"j{i}" for i in range(12)]))
    assert read_motion(path).joint_names == tuple(f"j{i}" for i in range(12))


@pytest.mark.parametrize("width", [19, 61])
def test_frames_of_motion_imitation_and_of_amp(tmp_path, width):
    rest = np.full((FRAMES, width - 19), 7.0)
    content = {"LoopMode": "Wrap", "FrameDuration": 0.02, "MotionWeight": 0.5}
    content["Frames"] = np.hstack([POS, XYZW, JOINTS, rest]).tolist()
    path = tmp_path / "pace.txt"
    path.write_text(json.dumps(content))
    motion = read_motion(path)
    assert motion.fps == pytest.approx(50.0)
    assert (motion.weight, motion.quat_order, motion.joint_order) == (0.5, "xyzw", "legs")
    np.testing.assert_array_equal(motion.joint_pos, JOINTS)


@pytest.mark.parametrize("joints", LAFAN_JOINTS)
def test_a_csv_of_retargeted_lafan1(tmp_path, joints):
    assert len(set(LAFAN_JOINTS[joints])) == joints
    table = np.hstack([POS, XYZW, np.tile(np.arange(joints) / 100, (FRAMES, 1))])
    path = tmp_path / "dance1_subject1.csv"
    np.savetxt(path, table, delimiter=",")
    motion = read_motion(path)
    assert (motion.fps, motion.quat_order) == (30.0, "xyzw")
    assert motion.joint_names == LAFAN_JOINTS[joints]
    np.testing.assert_allclose(motion.joint_pos, table[:, 7:])


def test_a_csv_with_a_header_is_found_by_its_names(tmp_path):
    path = tmp_path / "walk.csv"
    names = ["hip", "qx", "qy", "qz", "qw", "knee", "time", "z", "y", "x"]
    time = 3.0 + np.arange(FRAMES)[:, None] / 40
    table = [JOINTS[:, :1], XYZW, JOINTS[:, 1:2], time, POS[:, ::-1]]
    np.savetxt(path, np.hstack(table), delimiter=",", header=",".join(names), comments="")
    motion = read_motion(path)
    assert motion.joint_names == ("hip", "knee") and motion.quat_order == "wxyz"
    assert motion.fps == pytest.approx(40.0)
    np.testing.assert_allclose(motion.root_quat, WXYZ)
    np.testing.assert_allclose(motion.root_pos, POS)
    np.testing.assert_allclose(motion.joint_pos, JOINTS[:, :2])


def test_a_csv_without_a_header_says_little(tmp_path):
    path = tmp_path / "walk.csv"
    np.savetxt(path, np.hstack([POS, WXYZ, JOINTS]), delimiter=",")
    motion = read_motion(path)
    assert (motion.fps, motion.quat_order, motion.joint_names) == (None, None, None)


def npz(**arrays):
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def bomb():
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
        for name in ("joint_pos", "body_pos_w"):
            packed.writestr(f"{name}.npy", b"0" * 1000)
    raw = bytearray(stream.getvalue())
    at = raw.index(b"PK\x01\x02")
    while at >= 0:
        raw[at + 24 : at + 28] = (0xFFFFFFFE).to_bytes(4, "little")  # what it claims to unpack to
        at = raw.find(b"PK\x01\x02", at + 4)
    return bytes(raw)


BODIES = {"body_pos_w": np.zeros((2, 1, 3)), "body_quat_w": np.ones((2, 1, 4)), "fps": [50]}
WRONG = {
    "a.bvh": (b"HIERARCHY", "lacoloco retarget takes it"),
    "a.xyz": (b"", "known are .npz"),
    "a.npz": (b"PK", "is no .npz of numbers"),
    "bomb.npz": (bomb(), "unpacks to more"),
    "other.npz": (npz(qpos=POS), "has no joint_pos, body_pos_w, body_quat_w"),
    "objects.npz": (npz(joint_pos=np.array([None]), **BODIES), "is no .npz of numbers"),
    "short.npz": (npz(joint_pos=np.zeros((3, 12)), **BODIES), "joint_pos has shape"),
    "a.pkl": (pickle.dumps({"poses": POS}), "holds poses; a pickle of GMR has fps, root_pos"),
    "list.pkl": (pickle.dumps([1, 2]), "holds no table"),
    "text.pkl": (pickle.dumps({"fps": 30, "frames": "a"}), "frames is no table of numbers"),
    "lines.pkl": (pickle.dumps({"a\nb": 1}), "holds a b; a pickle of GMR"),
    "point.pkl": (
        pickle.dumps({"fps": 30, "root_pos": 5, "root_rot": XYZW, "dof_pos": JOINTS}),
        r"root_pos has shape \(\)",
    ),
    "ragged.pkl": (pickle.dumps({"fps": 30, "frames": [[1.0], [1.0, 2.0]]}), "differ in length"),
    "mixed.pkl": (pickle.dumps({"fps": 30, "frames": [[1.0, "a"]]}), "other than numbers"),
    "a.txt": (b"{", "is no JSON"),
    "deep.json": (b"[" * 100_000, "is no JSON"),
    "b.txt": (b"[1, 2]", "has no Frames"),
    "zero.txt": (json.dumps({"FrameDuration": 0, "Frames": [[0.0] * 19]}).encode(), "each of 0 s"),
    "rates.txt": (
        json.dumps({"FrameDuration": [[1], [1, 2]], "Frames": [[0.0] * 19]}).encode(),
        "frames per second are no number",
    ),
    "quote.csv": (b'x,"y\n' + b"1,2\n" * 50_000, "is no CSV"),
    "a.csv": (b"1,2\n3\n", "line 2 has 1 values, not 2"),
    "word.csv": (b"1,2,x\n", "could not convert"),
    "head.csv": (b"x,y,z,a\n1,2,3,4\n", "no root_qw, root_qx, root_qy, root_qz"),
    "nan.csv": (b"0,0,0,nan,0,0,1,0\n" * 3, "root_quat is not finite in frame 0"),
    "one.csv": (b"0,0,0,1,0,0,0,0\n", "has 1 frames"),
    "bytes.csv": (b"\xff\xfe\x00", "is no text"),
}


@pytest.mark.parametrize("name", WRONG)
def test_files_that_hold_no_motion_are_refused_in_one_line(tmp_path, name):
    content, words = WRONG[name]
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(DatasetError, match=words) as caught:
        read_motion(path)
    assert "\n" not in str(caught.value) and path.stem in str(caught.value)


def test_what_is_no_file_is_refused(tmp_path):
    with pytest.raises(DatasetError, match="no such file"):
        read_motion(tmp_path / "gone.npz")
    with pytest.raises(DatasetError, match="is no regular file"):
        read_motion(tmp_path)
