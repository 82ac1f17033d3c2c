from pathlib import Path

from lacoloco.datasets.store import RunStore


def test_runs_are_found_from_a_folder_below(tmp_path, monkeypatch):
    monkeypatch.delenv("LACOLOCO_RUNS")
    below = tmp_path / "a" / "b"
    below.mkdir(parents=True)
    monkeypatch.chdir(below)
    assert RunStore().root == Path("runs")  # nothing above holds runs
    RunStore(tmp_path / "runs").begin("dog", "retarget")
    assert RunStore().root == tmp_path / "runs"
    (tmp_path / "a" / "runs").mkdir()  # a folder of that name alone holds none
    assert RunStore().root == tmp_path / "runs"
    (below / "runs").mkdir()
    assert RunStore().root == Path("runs")
