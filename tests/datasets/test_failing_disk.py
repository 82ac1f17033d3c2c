"""The writer on a disk that fails: every call to the file system fails once, each in its turn."""

from __future__ import annotations

import errno
import fcntl
import io
import os
from contextlib import contextmanager

import numpy as np
import pytest

from lacoloco.datasets.artifact import read_artifact, write_artifact
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.store import RunStore

CALLS = {
    io: ("open",),
    os: ("open", "mkdir", "rename", "replace", "unlink", "fsync", "listdir", "scandir"),
    fcntl: ("lockf", "flock"),
}
"""What the writer changes the disk with, or looks at it."""


class FailingDisk:
    """Counts the calls, and lets one of them fail."""

    def __init__(self, monkeypatch, root, fail_at=None, reason=errno.ENOSPC):
        self.count, self.failed = 0, ""
        for module, names in CALLS.items():
            for name in names:
                real = getattr(module, name)
                monkeypatch.setattr(
                    module, name, self.wrapped(real, f"{module.__name__}.{name}", fail_at, reason)
                )
        self.root = str(root)

    def wrapped(self, real, name, fail_at, reason):
        def call(*arguments, **options):
            place = arguments[0]
            ours = not isinstance(place, (str, os.PathLike)) or self.root in os.fspath(place)
            if ours:
                self.count += 1
                if self.count - 1 == fail_at:
                    self.failed = name
                    raise OSError(reason, os.strerror(reason), str(place))
            return real(*arguments, **options)

        return call


def make(root, value, replaced=False):
    """One version of a stage, with a checkpoint that is written twice."""
    store = RunStore(root)
    store.use("dog")
    directory = store.begin("dog", "train-low")
    options = {"metadata": {}, "config": {}, "seed": 0, "robot": None}
    for turn in range(2):
        arrays = {"a": np.full(100, value + turn)}
        place = directory.file("x.checkpoint.h5")
        write_artifact(place, "lacoloco/checkpoint", arrays, replace=True, **options)
    arrays = {"a": np.full(1000, value)}
    write_artifact(directory.file("artifact.h5"), "lacoloco/policy", arrays, **options)
    return directory.complete()


@contextmanager
def failing(root, fail_at=None, reason=errno.ENOSPC):
    with pytest.MonkeyPatch.context() as patch:
        yield FailingDisk(patch, root, fail_at, reason)


def number_of_calls(tmp_path):
    make(tmp_path / "count", 1)
    with failing(tmp_path / "count") as disk:
        make(tmp_path / "count", 2)
    return disk.count


@pytest.mark.parametrize("reason", [errno.ENOSPC, errno.EIO, errno.EACCES])
def test_whatever_fails_nothing_is_lost_and_the_rerun_works(tmp_path, reason):
    calls = number_of_calls(tmp_path)
    assert calls > 20
    seen = set()
    for turn in range(calls):
        root = tmp_path / f"{turn}"
        before = make(root, 1).read_bytes()
        with failing(root, turn, reason) as disk:
            try:
                make(root, 2)
            except ArtifactError as error:
                assert "\n" not in str(error)
        assert disk.failed, turn
        seen.add(disk.failed)
        store = RunStore(root)
        versions = store.all("dog", "train-low")
        assert versions[0].read_bytes() == before
        for path, value in zip(versions, (1, 2), strict=False):
            assert (read_artifact(path).arrays["a"] == value).all()
        for partial in store.partials("dog", "train-low"):
            for path in partial.path.glob("*.h5"):
                read_artifact(path)  # whole, or not there
        assert (read_artifact(make(root, 3)).arrays["a"] == 3).all()
    assert {"os.fsync", "os.mkdir", "os.replace", "os.rename", "io.open"} <= seen
