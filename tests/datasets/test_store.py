import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from lacoloco.datasets.artifact import read_artifact, write_artifact
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.lineage import lineage
from lacoloco.datasets.provenance import Parent
from lacoloco.datasets.robot_record import RobotRecord
from lacoloco.datasets.store import RunStore
from lacoloco.datasets.work import Work


@pytest.fixture
def store(tmp_path):
    return RunStore(tmp_path / "runs")


def write(path, value=0, parents=()):
    return write_artifact(
        path,
        "lacoloco/motions",
        {"a": np.array([value])},
        metadata={},
        config={},
        seed=0,
        robot=None,
        parents=parents,
    )


def finish(store, run="dog", stage="retarget", value=0, parents=()):
    stage_dir = store.begin(run, stage)
    write(stage_dir.file("artifact.h5"), value, parents)
    return stage_dir.complete()


def test_versions_count_up_and_newest_is_the_last_complete_one(store):
    first, second = finish(store), finish(store, value=1)
    store.begin("dog", "retarget")
    assert first == store.root / "dog/retarget/0001/artifact.h5"
    assert second == store.root / "dog/retarget/0002/artifact.h5"
    assert store.all("dog", "retarget") == [first, second]
    assert store.newest("dog", "retarget") == second
    assert (store.runs(), store.stages("dog")) == (["dog"], ["retarget"])


def test_ten_thousand_versions_sort_as_numbers(store):
    for number in (9999, 10000):
        folder = store.root / "dog/retarget" / str(number)
        write(folder / "artifact.h5")
    assert store.newest("dog", "retarget").parent.name == "10000"
    assert store.begin("dog", "retarget").final.name == "10001"


def test_nothing_is_visible_before_completion(store):
    stage_dir = store.begin("dog", "retarget")
    write(stage_dir.file("artifact.h5"))
    assert store.all("dog", "retarget") == []
    with pytest.raises(ArtifactError, match="retarget --run dog --resume"):
        store.newest("dog", "retarget")
    stage_dir.complete()
    assert sorted(p.name for p in (store.root / "dog/retarget/0001").iterdir()) == ["artifact.h5"]
    assert [p.name for p in (store.root / "dog/retarget").iterdir()] == ["0001"]


def test_completing_without_an_artifact_is_our_bug(store):
    with pytest.raises(RuntimeError, match="without an artifact.h5"):
        store.begin("dog", "retarget").complete()


def test_an_artifact_keeps_the_hashes_of_the_files_beside_it(store):
    stage_dir = store.begin("dog", "retarget")
    (stage_dir.path / "reports").mkdir()
    for name in ("page.html", "reports/a.png", "old.checkpoint.h5", ".hidden"):
        stage_dir.file(name).write_text(name)
    write(stage_dir.file("artifact.h5"))
    done = stage_dir.complete()
    assert read_artifact(done).files == {
        name: hashlib.sha256(name.encode()).hexdigest() for name in ("page.html", "reports/a.png")
    }
    assert read_artifact(write(store.root / "alone.h5")).files is None


def test_the_files_beside_are_on_disk_before_the_name_is(store, monkeypatch):
    synced = []
    real = os.fsync
    monkeypatch.setattr(os, "fsync", lambda fd: (synced.append(os.fstat(fd).st_ino), real(fd)))
    stage_dir = store.begin("dog", "retarget")
    (stage_dir.path / "reports").mkdir()
    page = stage_dir.file("reports/page.html")
    page.write_text("page")
    write(stage_dir.file("artifact.h5"))
    assert {page.stat().st_ino, page.parent.stat().st_ino} <= set(synced)


def test_completing_never_replaces(store):
    stage_dir = store.begin("dog", "retarget")
    write(stage_dir.file("artifact.h5"))
    stage_dir.final.mkdir()
    with pytest.raises(ArtifactError, match="exists already"):
        stage_dir.complete()
    assert stage_dir.file("artifact.h5").is_file()


def test_resume_continues_the_newest_partial_of_that_label(store):
    one = store.begin("dog", "train-low", label="gan-seed0")
    one.file("checkpoint.h5").write_text("x")
    two = store.begin("dog", "train-low", label="drail-seed0")
    assert (one.final.name, two.final.name) == ("0001", "0002")
    assert store.begin("dog", "train-low", resume=True).path == two.path
    again = store.begin("dog", "train-low", resume=True, label="gan-seed0")
    assert (again.path, again.final, again.label) == (one.path, one.final, "gan-seed0")
    assert again.file("checkpoint.h5").read_text() == "x"
    for options in ({"label": "other"}, {}):
        stage = "train-low" if options else "eval"
        with pytest.raises(ArtifactError, match="leave out --resume"):
            store.begin("dog", stage, resume=True, **options)


def test_a_partial_that_another_process_works_on_is_not_resumed(store):
    code = (
        "import sys\nfrom pathlib import Path\nfrom lacoloco.datasets.store import RunStore\n"
        "stage = RunStore(Path(sys.argv[1])).begin('dog', 'train-low')\n"
        "print('ready', flush=True)\nsys.stdin.read()\n"
    )
    other = subprocess.Popen(
        [sys.executable, "-c", code, str(store.root)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert other.stdout.readline() == "ready\n"
    with pytest.raises(ArtifactError, match="another process"):
        store.begin("dog", "train-low", resume=True)
    other.kill()
    other.communicate()
    assert store.begin("dog", "train-low", resume=True).final.name == "0001"


def test_leftovers_of_a_killed_writer_are_removed_on_resume(store):
    stage_dir = store.begin("dog", "train-low")
    stage_dir.file(".writing-123-checkpoint.h5").write_text("half")
    stage_dir.file("checkpoint.h5").write_text("whole")
    resumed = store.begin("dog", "train-low", resume=True)
    names = {p.name for p in resumed.path.iterdir()}
    assert "checkpoint.h5" in names
    assert not any(name.startswith(".writing") for name in names)


def test_a_stage_killed_between_artifact_and_name_repeats_its_last_step(store):
    """Neither is it refused because the artifact is there, nor is what it goes on from lost."""
    stage_dir = store.begin("dog", "train-low")
    stage_dir.file("x.checkpoint.h5").write_text("state")
    write(stage_dir.file("artifact.h5"))
    resumed = store.begin("dog", "train-low", resume=True)
    assert resumed.file("x.checkpoint.h5").read_text() == "state"
    write(resumed.file("artifact.h5"), 1)
    done = resumed.complete()
    assert [path.name for path in done.parent.iterdir()] == ["artifact.h5"]
    assert read_artifact(done).arrays["a"] == [1]


KILLED = """
import os, signal, sys
from pathlib import Path
from lacoloco.datasets.robot_record import RobotRecord
from lacoloco.datasets.store import RunStore
from lacoloco.datasets.work import Work

store, last, count = RunStore(Path(sys.argv[1])), int(sys.argv[2]), 0


def touched(event, about):
    global count
    if event in ("open", "os.mkdir", "os.rename") and sys.argv[1] in str(about[0]):
        if count == last:
            os.kill(os.getpid(), signal.SIGKILL)
        count += 1


sys.addaudithook(touched)
store.use("dog")
store.begin("dog", "train-low", work=Work({}, 0, RobotRecord("solo12", "abc")))
print(count)
"""


def test_a_begun_version_says_what_it_was_begun_with_whenever_it_is_killed(tmp_path):
    def begin(root, last):
        command = [sys.executable, "-c", KILLED, str(root), str(last)]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    count = int(begin(tmp_path / "all", -1).stdout)
    assert count > 5
    for last in range(count):
        store = RunStore(tmp_path / str(last))
        assert begin(store.root, last).returncode == -9
        for left in store.partials("dog", "train-low"):
            assert Work.read(left.path) is not None
        for path in store.leftovers("dog"):
            assert store.clean(path)
        assert [path.name for path in store.root.rglob(".*")] in (
            [[], [".last"], [".numbering"]] + [[".last", ".numbering"], [".numbering", ".last"]]
        )


@pytest.mark.parametrize("harm", ["changed", "gone"])
def test_the_lineage_has_the_hash_of_what_was_used(store, tmp_path, harm):
    """Not of what lies there hours later, when the artifact is written."""
    source = tmp_path / "motions.bvh"
    source.write_bytes(b"before")
    digest = hashlib.sha256(b"before").hexdigest()
    inputs = (Parent(str(source), digest),)
    stage_dir = store.begin("dog", "train-low", work=Work({}, 0, RobotRecord("a", "b"), inputs))
    source.unlink()
    if harm == "changed":
        source.write_bytes(b"after")
    write(stage_dir.file("artifact.h5"), parents=[source])
    (_, parent) = lineage(stage_dir.complete())
    assert (parent.sha256, parent.state) == (digest, "missing" if harm == "gone" else "changed")


def test_what_a_killed_stage_without_resumption_left_goes_with_the_next(store):
    left = store.begin("dog", "eval", at_once=True)
    left._release()
    mine = store.begin("dog", "eval", at_once=True)
    assert [one.path for one in store.partials("dog", "eval")] == [mine.path]
    assert mine.final.name == "0002"


def test_discard_deletes_partials_only(store):
    stage_dir = store.begin("dog", "retarget")
    stage_dir.discard()
    assert store.partials("dog", "retarget") == []
    complete = store.begin("dog", "retarget")
    write(complete.file("artifact.h5"))
    complete.complete()
    with pytest.raises(ArtifactError, match="stays"):
        complete.discard()


def test_missing_artifacts_name_the_verb(store):
    with pytest.raises(ArtifactError, match="lacoloco retarget --run dog.*known: none yet"):
        store.newest("dog", "retarget")
    finish(store)
    with pytest.raises(ArtifactError, match="lacoloco train-low --run dog`$"):
        store.newest("dog", "train-low")
    with pytest.raises(ArtifactError, match="known: dog"):
        store.newest("cat", "train-low")


def test_last_run(store):
    assert store.last_run() is None
    store.use("dog")
    store.use("cat-2")
    assert RunStore(store.root).last_run() == "cat-2"
    (store.root / ".last").write_bytes(b"\xff\x00../../etc")
    assert store.last_run() is None


@pytest.mark.parametrize("name", ["", "../up", "a/b", ".hidden", "a b", "x" * 101, "-dash"])
def test_names_that_are_no_directory_names(store, name):
    for call in (store.use, lambda n: store.begin(n, "retarget"), store.stages):
        with pytest.raises(ArtifactError, match="run '"):
            call(name)


def test_root_comes_from_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("LACOLOCO_RUNS", str(tmp_path / "elsewhere"))
    assert RunStore().root == tmp_path / "elsewhere"
    monkeypatch.delenv("LACOLOCO_RUNS")
    assert str(RunStore().root) == "runs"


def test_read_only_run_directory(read_only_folder):
    store = RunStore(read_only_folder / "runs")
    for call in (lambda: store.use("dog"), lambda: store.begin("dog", "retarget")):
        with pytest.raises(ArtifactError, match="permission denied") as caught:
            call()
        assert "\n" not in str(caught.value)


def test_runs_directory_that_is_a_file(tmp_path):
    (tmp_path / "runs").write_text("")
    with pytest.raises(ArtifactError, match="cannot create the run directory"):
        RunStore(tmp_path / "runs").begin("dog", "retarget")


def test_lineage_goes_back_to_the_source_file_also_after_moving_the_runs(store, tmp_path):
    mocap = tmp_path / "dog.bvh"
    mocap.write_text("HIERARCHY")
    clips = finish(store, parents=[mocap])
    low = finish(store, stage="train-low", value=1, parents=[clips])
    finish(store, stage="eval", value=2, parents=[low, clips])
    os.rename(store.root, tmp_path / "moved")
    found = lineage(tmp_path / "moved/dog/eval/0001/artifact.h5")
    shape = [(a.depth, a.path.parts[-3] if a.header else a.path.name, a.state) for a in found]
    assert shape == [
        (0, "eval", "ok"),
        (1, "train-low", "ok"),
        (2, "retarget", "ok"),
        (3, "dog.bvh", "ok"),
        (1, "retarget", "ok"),  # its own parents are listed above
    ]


def test_lineage_tells_what_changed_vanished_or_broke(store, tmp_path):
    mocap = tmp_path / "dog.bvh"
    mocap.write_text("HIERARCHY")
    clips = finish(store, parents=[mocap])
    low = finish(store, stage="train-low", value=1, parents=[clips])
    mocap.write_text("other")
    assert [a.state for a in lineage(low)] == ["ok", "ok", "changed"]
    mocap.unlink()
    assert [a.state for a in lineage(low)] == ["ok", "ok", "missing"]
    clips.write_bytes(clips.read_bytes()[:100])
    assert [a.state for a in lineage(low)] == ["ok", "damaged"]
    assert read_artifact(low).arrays["a"][0] == 1


def test_processes_that_begin_at_once_get_numbers_of_their_own(store, tmp_path):
    """Also under different labels, where no directory's name tells them of each other."""
    code = (
        "import sys; from pathlib import Path; from lacoloco.datasets.store import RunStore\n"
        "store = RunStore(Path(sys.argv[1]))\n"
        "for index in range(8): store.begin('run', 'stage', label=f'{sys.argv[2]}-{index}')\n"
    )
    command = [sys.executable, "-c", code, str(store.root)]
    running = [subprocess.Popen([*command, f"process{index}"]) for index in range(3)]
    assert [process.wait(timeout=300) for process in running] == [0, 0, 0]
    numbers = [stage_dir.final.name for stage_dir in store.partials("run", "stage")]
    assert numbers == [f"{index:04d}" for index in range(1, 25)]


def test_writers_and_a_concurrent_resume_do_not_take_from_each_other(store):
    """Every version is completed by the one process that worked in it, and no lock stays."""
    code = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from lacoloco.datasets.errors import ArtifactError\n"
        "from lacoloco.datasets.store import RunStore\n"
        "store, end, done = RunStore(Path(sys.argv[1])), time.monotonic() + 4, 0\n"
        "while time.monotonic() < end:\n"
        "    try: stage = store.begin('run', 'stage', resume=sys.argv[2] == 'resume')\n"
        "    except ArtifactError as error:\n"
        "        assert 'no unfinished' in str(error) or 'process' in str(error), error\n"
        "        continue\n"
        "    stage.file('mine').open('x').close()\n"
        "    stage.file('artifact.h5').write_bytes(b'x')\n"
        "    stage.complete()\n"
        "    done += 1\n"
        "print(done)\n"
    )
    roles = ("write", "write", "resume")
    running = [
        subprocess.Popen(
            [sys.executable, "-c", code, str(store.root), role],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for role in roles
    ]
    ended = [process.communicate(timeout=300) for process in running]
    assert [process.returncode for process in running] == [0, 0, 0], ended
    versions = store.all("run", "stage")
    assert len(versions) == sum(int(out) for out, _ in ended) > 10
    assert store.partials("run", "stage") == []
    for path in versions:
        assert sorted(p.name for p in path.parent.iterdir()) == ["artifact.h5", "mine"]


@pytest.mark.parametrize("name", [".numbering", "dog/train-low/.0001.partial/.lock"])
def test_a_link_where_a_lock_belongs_is_refused_and_its_target_stays(store, tmp_path, name):
    diary = tmp_path / "diary.txt"
    diary.write_text("precious")
    place = store.root / name
    place.parent.mkdir(parents=True)
    place.symlink_to(diary)
    with pytest.raises(ArtifactError, match="link"):
        store.begin("dog", "train-low", resume=name.endswith(".lock"))
    assert diary.read_text() == "precious"


def test_a_discarded_version_is_gone_at_once_for_a_resume(store, monkeypatch):
    stage_dir = store.begin("dog", "train-low")
    monkeypatch.setattr("shutil.rmtree", lambda path: None)  # killed while it deletes
    stage_dir.discard()
    assert store.partials("dog", "train-low") == []
    with pytest.raises(ArtifactError, match="leave out --resume"):
        store.begin("dog", "train-low", resume=True)
