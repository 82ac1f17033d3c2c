"""Clips that an earlier call of retarget made are kept, and only those that are still right."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from lacoloco.datasets.artifact import read_artifact
from lacoloco.datasets.beside import FINISHED_CLIPS, FINISHED_CLIPS_BEFORE
from lacoloco.datasets.clip import load_clips
from lacoloco.datasets.lineage import lineage
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines import retarget
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retarget import RetargetConfig
from lacoloco.pipelines.retargeting.worker import Worker
from lacoloco.pipelines.stage import StageContext

QUICK = RetargetConfig(pictures=False)

retarget_run = partial(retarget.run, robot="solo12")


@pytest.fixture
def context(tmp_path):
    return StageContext(RunStore(tmp_path / "runs"), "dog", command="lacoloco retarget")


def arrays(result):
    return read_artifact(result.artifact).arrays


def test_only_what_is_missing_is_made(context, short_dog, monkeypatch):
    files = [short_dog(), short_dog(slice(100, 160), "b.bvh")]
    first = retarget_run(QUICK, context, sources=files[:1])
    made = []
    work = Worker.work
    monkeypatch.setattr(Worker, "work", lambda self, task, *rest: (
        made.append(task.name), work(self, task, *rest))[1])  # fmt: skip
    second = retarget_run(QUICK, context, sources=files, jobs=1)
    assert made == ["b"]
    assert second.metrics["kept"] == 1
    assert [clip.name for clip in load_clips(second.artifact)] == ["short", "b"]
    np.testing.assert_array_equal(arrays(second)["joint_pos"][:60], arrays(first)["joint_pos"])
    # all is there: nothing is made, and nothing is written
    third = retarget_run(QUICK, context, sources=files, jobs=1)
    assert third.artifact == second.artifact
    assert len(context.store.all("dog", "retarget")) == 2
    # another config, another motion of the file, or asked for: anew
    made.clear()
    retarget_run(replace(QUICK, fps=30.0), context, sources=files[:1])
    short_dog(slice(20, 80))
    retarget_run(QUICK, context, sources=files[:1])
    retarget_run(QUICK, context, sources=files[:1], force=True)
    assert made == ["short"] * 3


def test_a_recording_that_changes_meanwhile_is_not_kept(context, short_dog, monkeypatch):
    files = [short_dog(), short_dog(slice(100, 160), "b.bvh")]
    work = Worker.work

    def changed(self, task, *rest):
        if task.name == "b":
            files[0].write_bytes(files[0].read_bytes() + b"\n")
        return work(self, task, *rest)

    monkeypatch.setattr(Worker, "work", changed)
    with pytest.raises(StageError, match=r"short\.bvh: has changed since the call began"):
        retarget_run(QUICK, context, sources=files, jobs=1)
    monkeypatch.setattr(Worker, "work", work)
    result = retarget_run(QUICK, context, sources=files, jobs=1)
    assert result.metrics["kept"] == 1
    assert [one.state for one in lineage(result.artifact)] == ["ok"] * 3


@pytest.mark.parametrize("force", [False, True], ids=["as it is", "by force"])
@pytest.mark.parametrize("name", [FINISHED_CLIPS, FINISHED_CLIPS_BEFORE])
def test_what_a_killed_run_finished_is_taken_over(context, short_dog, monkeypatch, name, force):
    files = [short_dog(), short_dog(slice(100, 160), "b.bvh")]
    work = Worker.work

    def interrupted(self, task, *rest):
        if task.name == "b":
            raise KeyboardInterrupt
        return work(self, task, *rest)

    monkeypatch.setattr(Worker, "work", interrupted)
    with pytest.raises(KeyboardInterrupt):
        retarget_run(QUICK, context, sources=files, jobs=1, force=force)
    (left,) = context.store.partials("dog", "retarget")
    (left.path / FINISHED_CLIPS).rename(left.path / name)
    monkeypatch.setattr(Worker, "work", work)
    result = retarget_run(QUICK, replace(context, resume=True), sources=files, jobs=1, force=force)
    assert result.metrics["skipped"] == []
    assert result.metrics["kept"] == 1
    assert not context.store.partials("dog", "retarget")
    assert [clip.name for clip in load_clips(result.artifact)] == ["short", "b"]
    assert not (result.artifact.parent / name).exists()
