"""Files that were made to hurt: each is refused in one line, soon, and without memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest

from lacoloco.datasets.artifact import read_artifact, read_header, write_artifact
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.hashing import hash_file
from lacoloco.datasets.lineage import lineage

SOON = 5.0  # s


@pytest.fixture
def path(tmp_path):
    return made(tmp_path / "artifact.h5")


def made(path, parents=(), **metadata):
    return write_artifact(
        path,
        "lacoloco/motions",
        {"a": np.arange(4.0), "group/b": np.arange(3)},
        metadata=metadata,
        config={},
        seed=0,
        robot=None,
        parents=parents,
    )


def refused(path, *words):
    begin = time.monotonic()
    with pytest.raises(ArtifactError) as caught:
        read_artifact(path)
    assert time.monotonic() - begin < SOON
    message = str(caught.value)
    assert "\n" not in message
    for word in (str(path), *words):
        assert word in message


def groups_within_groups(file):
    """2 names per group: 2 ** 40 ways through a few kilobytes."""
    group = file["arrays"]
    for depth in range(40):
        below = group.create_group("x")
        group["y"] = below
        group = below
        assert depth < 40


def a_group_in_itself(file):
    file["arrays/loop"] = file["arrays"]


def two_names(file):
    file["arrays/again"] = file["arrays/a"]


def never_written(file):
    file["arrays"].create_dataset("huge", shape=(10**8,), dtype="f8")


def filled_chunks(file):
    file["arrays"].create_dataset("huge", shape=(10**8,), dtype="f8", chunks=(10**6,))


def compressed(file):
    file["arrays"].create_dataset("z", data=np.zeros(10**5), compression="gzip")


def virtual(file):
    layout = h5py.VirtualLayout(shape=(4,), dtype="f8")
    layout[:] = h5py.VirtualSource(file["arrays/a"])
    file["arrays"].create_virtual_dataset("v", layout)


def elsewhere(file):
    file["arrays"].create_dataset("e", (4,), "f8", external=[("/etc/passwd", 0, 32)])


def objects(file):
    file["arrays"].create_dataset("o", data=["text"], dtype=h5py.string_dtype())


def nothing(file):
    file["arrays"]["null"] = h5py.Empty("f8")


def a_type(file):
    file["arrays"]["type"] = np.dtype("f8")


def deep(file):
    group = file["arrays"]
    for _ in range(500):
        group = group.create_group("d")


def soft(file):
    file["arrays/soft"] = h5py.SoftLink("/arrays/a")


def more_than_arrays(file):
    file["other"] = np.zeros(3)


def an_array_as_root(file):
    del file["arrays"]
    file["arrays"] = np.zeros(3)


def many_attributes(file):
    for index in range(1000):
        file.attrs[f"a{index}"] = 1


def a_list_as_attribute(file):
    file.attrs["seed"] = np.arange(1000)


KINDS = [
    (groups_within_groups, "a second name"),
    (a_group_in_itself, "a second name"),
    (two_names, "a second name"),
    (never_written, "never written"),
    (filled_chunks, "no plain array"),
    (compressed, "no plain array"),
    (virtual, "no plain array"),
    (elsewhere, "no plain array"),
    (objects, "no plain array"),
    (nothing, "no array of numbers"),
    (a_type, "no array of numbers"),
    (deep, "too deep"),
    (soft, "is a link"),
    (more_than_arrays, "more than arrays"),
    (an_array_as_root, "arrays is no group"),
    (many_attributes, "too many attributes"),
    (a_list_as_attribute, "neither text nor number"),
]


@pytest.mark.parametrize(
    ("spoil", "words"), KINDS, ids=lambda value: getattr(value, "__name__", "")
)
def test_a_file_that_is_unlike_ours_is_refused(path, spoil, words):
    with h5py.File(path, "r+") as file:
        spoil(file)
    refused(path, words, "cut short or damaged")


def test_arrays_in_another_file_are_not_followed(path, tmp_path):
    other = made(tmp_path / "other.h5")
    with h5py.File(path, "r+") as file:
        del file["arrays"]
        file["arrays"] = h5py.ExternalLink(str(other), "/arrays")
    refused(path, "is a link")


def test_a_pipe_and_a_device_are_no_artifacts(tmp_path):
    pipe = tmp_path / "pipe.h5"
    os.mkfifo(pipe)
    refused(pipe, "no regular file")
    device = tmp_path / "zero.h5"
    device.symlink_to("/dev/zero")
    refused(device, "no regular file")


def test_links_in_a_circle_are_named(tmp_path):
    circle = tmp_path / "circle.h5"
    circle.symlink_to(circle)
    refused(circle, "symbolic links")


def test_a_file_that_another_program_writes_is_not_called_damaged(path):
    code = (
        "import sys, h5py\n"
        "file = h5py.File(sys.argv[1], 'r+', locking=False)\n"
        "print('open', flush=True)\n"
        "sys.stdin.read()\n"
    )
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    writer = subprocess.Popen([sys.executable, "-c", code, str(path)], **pipes)
    try:
        assert writer.stdout.readline() == b"open\n"
        with pytest.raises(ArtifactError, match="another program has it open") as caught:
            read_artifact(path)
        assert "damaged" not in str(caught.value)
    finally:
        writer.communicate(b"")
    assert read_artifact(path).seed == 0


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("metadata", "[" * 100_000),
        ("metadata", "5"),
        ("config", '{"a": ' * 50_000),
        ("parents", '[{"path": 5, "sha256": "x"}]'),
        ("parents", '[{"path": "x\\u0000", "sha256": "x"}]'),
        ("parents", '[{"path": "\\ud800", "sha256": "x"}]'),
        ("parents", json.dumps([{"path": "x" * 10_000, "sha256": "x"}])),
        ("parents", '{"path": "x"}'),
        ("parents", "[5]"),
        ("schema", "\xff".encode("latin-1")),
    ],
)
def test_a_header_of_another_form_is_refused(path, name, text):
    with h5py.File(path, "r+") as file:
        file.attrs[name] = np.bytes_(text if isinstance(text, bytes) else text.encode())
    for read in (read_header, read_artifact, lineage):
        with pytest.raises(ArtifactError, match="damaged"):
            read(path)


@pytest.mark.parametrize(
    ("schema", "key", "value"),
    [
        ("evaluation", "rows", [1]),
        ("evaluation", "rows", []),
        ("evaluation", "rows", [{"method": 5}]),
        ("evaluation", "rows", [{"falls_pct": "3"}]),
        ("evaluation", "rows", [{"episodes": -1}]),
        ("evaluation", "best", None),
        ("checkpoint", "iteration", "7"),
        ("checkpoint", "iteration", -1),
        ("checkpoint", "elapsed_s", float("nan")),
        ("checkpoint", "processes", 0),
        ("checkpoint", "structure", []),
        ("policy", "heads", [60_000]),
        ("policy", "task", {"text": 5}),
        ("motions", "joint_names", "abc"),
        ("playback", "recordings", [None]),
    ],
)
def test_metadata_of_another_form_is_refused_when_it_is_read(tmp_path, schema, key, value):
    path = tmp_path / "artifact.h5"
    options = {"config": {}, "seed": 0, "robot": None}
    write_artifact(path, f"lacoloco/{schema}", {}, metadata={key: value}, **options)
    for read in (read_header, read_artifact):
        with pytest.raises(ArtifactError, match=f"'{key}' in its metadata is of another form"):
            read(path)


def test_metadata_without_a_key_is_refused_when_it_is_needed(path):
    metadata = read_header(path).metadata
    assert metadata.get("rows") is None
    with pytest.raises(ArtifactError, match="its metadata has no 'rows'"):
        metadata["rows"]


def test_parents_named_twice_are_followed_once(tmp_path):
    path = made(tmp_path / "0.h5")
    for index in range(1, 30):
        path = made(tmp_path / f"{index}.h5", parents=[path, path])
    begin = time.monotonic()
    found = lineage(path)
    assert time.monotonic() - begin < SOON
    assert len(found) == 1 + 2 * 29
    assert {ancestor.state for ancestor in found} == {"ok"}
    assert max(ancestor.depth for ancestor in found) == 29


def test_a_parent_behind_a_pipe_or_a_circle_is_missing(tmp_path):
    source = tmp_path / "walk.bvh"
    source.write_text("HIERARCHY")
    path = made(tmp_path / "artifact.h5", parents=[source])
    expected = hash_file(source)
    source.unlink()
    os.mkfifo(source)
    assert [a.state for a in lineage(path)] == ["ok", "missing"]
    source.unlink()
    source.symlink_to(source)
    assert [(a.state, a.sha256) for a in lineage(path)] == [("ok", ""), ("missing", expected)]
