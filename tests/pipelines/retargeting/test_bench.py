from lacoloco.pipelines.retargeting import bench


def test_the_benchmark_answers_with_both_rates_and_their_ratio(monkeypatch):
    monkeypatch.setattr(bench, "REBUILT", 4)
    figures = bench.bench_retarget(rounds=1)
    assert figures["frames"] == 721
    ratio = figures["frames_per_second"] / figures["rebuilt_frames_per_second"]
    assert figures["ratio_to_engine"] == ratio
    assert ratio > 1
