import hashlib
from dataclasses import replace

import numpy as np
import pytest

from lacoloco.datasets import artifact as artifacts
from lacoloco.datasets import great_circles as circles
from lacoloco.datasets import hashing, rotations, series
from lacoloco.datasets.artifact import read_artifact, read_header, write_artifact
from lacoloco.datasets.clip import load_clips, save_clips
from lacoloco.datasets.errors import ArtifactError, DatasetError
from lacoloco.datasets.motion_library import MotionLibrary


def single(array):
    return array.astype(np.float32)


@pytest.fixture
def clips(make_clip):
    asked = make_clip("asked", frames=30)
    targets = np.random.default_rng(0).normal(size=asked.joint_pos.shape)
    return [
        make_clip("plain", frames=20),
        replace(asked, joint_target=targets, contacts=np.eye(30, 4, dtype=bool)),
        make_clip("short", frames=2, contacts=np.ones((2, 4), dtype=bool)),
    ]


def test_what_only_some_clips_know_has_rows_for_those_only(clips, tmp_path):
    path = save_clips(tmp_path / "clips.h5", clips, robot=None, config={})
    arrays = read_artifact(path).arrays
    assert arrays["joint_target"].shape == (30, 3) and arrays["contacts"].shape == (32, 4)
    assert arrays["contacts_clips"].tolist() == [1, 2]
    read = load_clips(path)
    assert [clip.contacts is None for clip in read] == [True, False, False]
    assert np.array_equal(read[1].joint_target, single(clips[1].joint_target))
    assert np.array_equal(read[-1].contacts, clips[2].contacts)
    assert [clip.name for clip in read[1:]] == ["asked", "short"]
    with pytest.raises(IndexError):
        read[3]


def test_clips_of_version_1_are_read(clips, tmp_path, monkeypatch):
    """It had an array for each clip of what only some know, and one hash over all bytes."""
    monkeypatch.setitem(artifacts.SCHEMAS, "lacoloco/motions", 1)
    monkeypatch.setattr(artifacts, "HASHED_IN_BLOCKS", ())
    arrays = {
        name: single(np.concatenate([getattr(clip, name) for clip in clips]))
        for name in series.SERIES
    }
    arrays |= {"offsets": np.array([0, 20, 50, 52]), "contacts/2": clips[2].contacts}
    arrays |= {"joint_target/1": single(clips[1].joint_target), "contacts/1": clips[1].contacts}
    table = [{"name": clip.name, "fps": clip.fps} for clip in clips]
    metadata = {"joint_names": list(clips[0].joint_names), "clips": table}
    old = write_artifact(
        tmp_path / "old.h5", "lacoloco/motions", arrays,
        metadata=metadata, config={}, seed=None, robot=None,
    )  # fmt: skip
    monkeypatch.undo()
    assert read_header(old).schema_version == 1
    new = load_clips(save_clips(tmp_path / "new.h5", clips, robot=None, config={}))
    for one, other in zip(load_clips(old), new, strict=True):
        for name in (*series.SERIES, *series.OPTIONAL, "weight", "name"):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name


def test_a_library_takes_the_arrays_of_the_file_as_they_are(make_clip, tmp_path):
    long = make_clip(frames=40_000, joints=12)
    path = save_clips(tmp_path / "clips.h5", [long, make_clip(joints=12)], robot=None, config={})
    before = path.read_bytes()
    clips = load_clips(path)
    stored = clips.flat.series["joint_pos"]
    assert any(np.shares_memory(stored, rows.numpy()) for rows in MotionLibrary(clips)._states)
    base = stored
    while not isinstance(base, np.memmap):
        base = base.base
    clips[0].joint_pos[:] = 7.0  # a process that writes into it does not change the file
    assert path.read_bytes() == before
    middle = path.stat().st_size // 2
    path.write_bytes(before[:middle] + bytes([before[middle] ^ 1]) + before[middle + 1 :])
    with pytest.raises(ArtifactError, match="does not match its hash"):
        load_clips(path)


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("joint_vel", lambda a: np.where(np.arange(len(a))[:, None] == 23, np.nan, a),
         "clip 'asked': joint_vel is not finite in frame 3"),
        ("root_quat", lambda a: 1.01 * a, "clip 'plain': root_quat is not of unit length"),
        ("joint_pos", lambda a: a[:, :2], "joint_pos has shape"),
        ("joint_pos", lambda a: a[:-1], "not 52 rows"),
        ("offsets", lambda a: a[:-1], "not those of 3 clips"),
        ("offsets", lambda a: a[[0, 2, 1, 3]], "not those of 3 clips"),
        ("offsets", lambda a: a + 0.5, "not those of 3 clips"),
        ("joint_target", lambda a: a[:-1], "joint_target has shape"),
        ("joint_target_clips", lambda a: a + 2, "not said to be of clips"),
        ("contacts_clips", lambda a: a[::-1], "not said to be of clips"),
        ("contacts", single, "contacts have shape"),
    ],
)  # fmt: skip
def test_arrays_that_do_not_fit_are_named(clips, tmp_path, name, change, words):
    good = read_artifact(save_clips(tmp_path / "a.h5", clips, robot=None, config={}))
    arrays = {**good.arrays, name: change(good.arrays[name])}
    path = write_artifact(
        tmp_path / "b.h5", "lacoloco/motions", arrays,
        metadata=good.metadata, config={}, seed=None, robot=None,
    )  # fmt: skip
    with pytest.raises(ArtifactError, match="do not fit together") as caught:
        load_clips(path)
    assert words in str(caught.value)


def test_clips_that_count_other_feet_are_not_of_one_robot(make_clip, tmp_path):
    four, two = np.ones((60, 4), dtype=bool), np.ones((60, 2), dtype=bool)
    clips = [make_clip("a", contacts=four), make_clip("b"), make_clip("c", contacts=two)]
    with pytest.raises(DatasetError, match="clips 'a' and 'c' differ in the width of their contac"):
        save_clips(tmp_path / "a.h5", clips, robot=None, config={})


def test_orientations_between_frames_are_those_of_each_clip_alone(monkeypatch):
    """However the frames are divided among the cores; the oracle takes one clip at a time."""
    random = np.random.default_rng(1)
    lengths = [1, 2, 50, 1, 33, 7]
    signs = np.where(random.random(sum(lengths)) < 0.4, -1.0, 1.0)[:, None]
    turns = np.cumsum(0.2 * random.normal(size=(sum(lengths), 3)), axis=0)
    quat = single(signs * rotations.exp_map(turns))
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    expected = []
    for start, stop in zip(offsets[:-1], offsets[1:], strict=True):
        q = rotations.continuous(rotations.normalize(quat[start:stop].astype(float)))
        row = np.zeros((len(q), 9))
        row[:, :4] = q
        aside = q[1:] - (q[:-1] * q[1:]).sum(1, keepdims=True) * q[:-1]
        sine = np.sqrt((aside**2).sum(1))
        row[:-1, 4:8], row[:-1, 8] = aside / sine[:, None], np.arcsin(sine)
        expected.append(row)
    for chunk in (1, 10, 1000):
        monkeypatch.setattr(circles, "_CHUNK", chunk)
        assert np.array_equal(
            circles.great_circles(quat, offsets), single(np.concatenate(expected))
        )


def test_a_hash_of_blocks_is_that_of_its_description(monkeypatch):
    arrays = {"b": np.arange(5, dtype=np.int64), "a": np.array([[1.0]], dtype=np.float32)}
    whole = hashlib.blake2b(digest_size=32)
    monkeypatch.setattr(hashing, "_BLOCK", 24)
    content = arrays["b"].tobytes()
    for head, parts in (
        ("a\0<f4\0(1, 1)\0", [arrays["a"].tobytes()]),
        ("b\0<i8\0(5,)\0", [content[:24], content[24:]]),
    ):
        whole.update(head.encode())
        for part in parts:
            whole.update(hashlib.blake2b(part, digest_size=32).digest())
    assert hashing.hash_blocks(arrays) == whole.hexdigest()
    arrays["b"][4] += 1
    assert hashing.hash_blocks(arrays) != whole.hexdigest()
