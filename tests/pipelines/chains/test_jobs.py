"""Jobs of their own: none stops the others."""

import os
import signal
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import cloudpickle
import pytest

from lacoloco.pipelines.chains.jobs import make_executor, run_jobs
from lacoloco.pipelines.errors import StageError

submitit = pytest.importorskip("submitit", reason="needs submitit: pip install 'lacoloco[cluster]'")
# This file is no module that a job could import.
cloudpickle.register_pickle_by_value(sys.modules[__name__])


def leave(folder, how):
    """What a job does: leave a mark, and end well, badly or not at all."""
    begin = time.time()
    if how == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if how == "failing":
        raise ValueError("no such luck")
    (Path(folder) / how).write_text(f"{begin} {os.environ.get('OMP_NUM_THREADS')}")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("told", "at_once", "expected"), [(None, 2, "4"), (None, 1, "None"), ("3", 2, "3")]
)
def test_jobs_on_one_machine_share_its_cores(tmp_path, monkeypatch, told, at_once, expected):
    monkeypatch.setattr("lacoloco.pipelines.chains.jobs.cores", lambda: 8)
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if told:
        monkeypatch.setenv("OMP_NUM_THREADS", told)
    jobs = {name: (str(tmp_path), name) for name in ("first", "second")}
    executor = make_executor("local", tmp_path / "jobs")
    assert not any(
        job.error for job in run_jobs(executor, leave, jobs, at_once=at_once, poll_s=0.1)
    )
    assert [(tmp_path / name).read_text().split()[1] for name in jobs] == [expected] * 2
    assert os.environ.get("OMP_NUM_THREADS") == told, "this process keeps all of them"


@pytest.mark.slow
def test_a_killed_job_and_a_failing_one_leave_the_others_alone(tmp_path):
    jobs = {name: (str(tmp_path), name) for name in ("killed", "failing", "first", "second")}
    executor = make_executor("local", tmp_path / "jobs")
    ended = list(run_jobs(executor, leave, jobs, at_once=2, poll_s=0.1))
    errors = {job.name: job.error for job in ended}
    assert set(errors) == set(jobs)
    assert errors["first"] == errors["second"] == ""
    assert errors["killed"]
    assert "no such luck" in errors["failing"]
    assert (tmp_path / "first").exists() and (tmp_path / "second").exists()
    left = {path.suffix for path in (tmp_path / "jobs").rglob("*") if path.is_file()}
    assert ".err" in left and ".pkl" not in left, "what was said stays, no pickle does"


class Executor:
    """Takes note of how many jobs are there at once; each is done at the third look."""

    def __init__(self):
        self.alive, self.most = [], 0

    def submit(self, work, *arguments):
        job = Job(arguments)
        self.alive.append(job)
        self.most = max(self.most, sum(job.looks < 3 for job in self.alive))
        return job


class Job:
    job_id = "7"

    def __init__(self, arguments):
        self.arguments, self.looks, self.cancelled = arguments, 0, False
        nothing = Path("no_such.pkl")
        self.paths = SimpleNamespace(
            folder=Path("there"), submitted_pickle=nothing, result_pickle=nothing
        )

    def done(self):
        self.looks += 1
        return self.looks >= 3

    def exception(self):
        return None

    def cancel(self):
        self.cancelled = True


def test_no_more_jobs_at_a_time_than_wanted():
    executor = Executor()
    jobs = {str(index): (index,) for index in range(7)}
    ended = list(run_jobs(executor, leave, jobs, at_once=3, poll_s=0.0))
    assert sorted(job.name for job in ended) == sorted(jobs)
    assert [job.arguments for job in executor.alive] == [(index,) for index in range(7)]
    assert executor.most == 3
    assert not any(job.cancelled for job in executor.alive)


def test_an_interrupted_wait_ends_the_jobs():
    executor = Executor()
    looking = run_jobs(executor, leave, {"a": (), "b": (), "c": ()}, at_once=2, poll_s=0.0)
    executor.submit(leave).looks = 9
    next(looking)
    looking.close()
    assert [job.cancelled for job in executor.alive[1:]] == [False, True]


def test_a_job_that_is_not_accepted_is_one_line(monkeypatch):
    executor = Executor()

    def refuse(work):
        raise RuntimeError("sbatch: error: invalid\n partition")

    executor.submit = refuse
    with pytest.raises(StageError, match="sbatch: error: invalid partition; see --slurm"):
        next(run_jobs(executor, leave, {"a": ()}, at_once=1))


def test_an_executor_that_does_not_exist_is_refused(tmp_path, monkeypatch):
    with pytest.raises(StageError, match="local or slurm"):
        make_executor("cloud", tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(StageError, match="--executor slurm"):
        make_executor("slurm", tmp_path / "jobs")


def test_without_submitit_the_message_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "submitit", None)
    with pytest.raises(StageError, match=r"lacoloco\[cluster\]"):
        make_executor("local", tmp_path)
