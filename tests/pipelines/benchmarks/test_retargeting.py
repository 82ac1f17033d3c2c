import pytest

from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.benchmarks import retargeting as bench


def test_the_benchmark_answers_with_both_rates_and_their_ratio(monkeypatch):
    monkeypatch.setattr(bench, "REBUILT", 4)
    metrics = bench.bench_retarget("solo12", rounds=1)
    assert metrics["frames"] == 721
    ratio = metrics["frames_per_second"] / metrics["rebuilt_frames_per_second"]
    assert metrics["ratio_to_engine"] == ratio
    assert ratio > 1


def test_both_modes_are_compared_on_the_same_targets_and_judged(dog_file):
    (row,) = bench.compare_modes("solo12", sources=[dog_file])
    assert row["frames"] == 60
    assert row["paper_skate"] > row["clip_skate"]
    assert row["error_ratio"] == row["clip_error"] / row["paper_error"]
    speed = {"frames_per_second": 1000.0, "ratio_to_engine": 6.0, "worst_excess_m2": 0.0}
    judged = {row["what"]: row for row in bench.verdicts([row], speed)}
    assert judged["paper mode, frames/s"]["met"]
    assert not judged["paper mode, ratio to rebuilding"]["met"]
    assert judged["limit hits"] == {"what": "limit hits", "must": "<= 0", "worst": 0, "met": True}


def test_files_that_cannot_be_used_are_told_apart(dog_file, tmp_path):
    bad = tmp_path / "bad.bvh"
    bad.write_text("no")
    good, reasons = bench.usable("solo12", [bad, dog_file])
    assert good == [dog_file]
    assert len(reasons) == 1 and str(bad) in reasons[0]


def test_no_other_start_is_better_on_the_sample(dog_file):
    metrics = bench.other_starts("solo12", sources=[dog_file], every=20, starts=2)
    assert metrics["frames_checked"] == 3
    assert metrics["worst_excess_m2"] <= 1e-6


@pytest.fixture
def dog_file(tmp_path):
    """A second of the bundled dog."""
    lines = DOG_BVH.read_text().splitlines()
    motion = lines.index("MOTION")
    text = [*lines[: motion + 1], "Frames: 60", *lines[motion + 2 : motion + 63]]
    path = tmp_path / "dog.bvh"
    path.write_text("\n".join([*text, ""]))
    return path
