"""Every verb of the chain, one after the other on the smallest preset, the way a person types
them.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lacoloco.datasets import provenance, published
from lacoloco.datasets.artifact import read_artifact, read_header
from lacoloco.datasets.store import RunStore
from lacoloco_cli.main import app

SMOKE = ("--preset", "smoke", "--quiet")


class Chain:
    """A runs folder, and `lacoloco` working in it."""

    def __init__(self, root):
        self.store = RunStore(root)

    def invoke(self, *arguments):
        return CliRunner().invoke(app, list(arguments), env={"LACOLOCO_RUNS": str(self.store.root)})

    def answer(self, *arguments):
        result = self.invoke(*arguments, "--json")
        assert result.exit_code == 0, result.stderr
        return json.loads(result.stdout)


@pytest.fixture(scope="module")
def chain(tmp_path_factory):
    """A run `tiny` with motions, a low and a high level, both of seed 0."""
    chain = Chain(tmp_path_factory.mktemp("chain") / "runs")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(provenance, "git_commit", lambda: "a" * 40)  # so that it can be published
        for arguments in (["generate", "--run", "tiny"], ["train-low"], ["train-high"]):
            result = chain.invoke(*arguments, *SMOKE)
            assert result.exit_code == 0, result.stderr
    return chain


@pytest.mark.slow
def test_generate_says_which_experts_perform(tmp_path):
    chain = Chain(tmp_path / "runs")
    generate = ("generate", "--preset", "smoke", "--run", "tiny")
    published = chain.invoke(*generate)
    assert published.exit_code == 0, published.stderr
    assert "--retrain" in published.stderr
    assert "expert walk" not in published.stderr
    retrained = chain.invoke(*generate, "--retrain")
    assert retrained.exit_code == 0, retrained.stderr
    assert "expert walk" in retrained.stderr
    assert len(chain.store.all("tiny", "experts")) == 1


@pytest.mark.slow
def test_generate_says_that_it_trains_experts_where_none_are_published(tmp_path, monkeypatch):
    monkeypatch.setattr(published, "find", lambda name: None)
    chain = Chain(tmp_path / "runs")
    generate = ("generate", "--preset", "smoke", "--run", "tiny", "--robot", "h1")
    first = chain.invoke(*generate)
    assert first.exit_code == 0, first.stderr
    assert "training" in first.stderr
    again = chain.invoke(*generate)
    assert again.exit_code == 0
    assert "training" not in again.stderr


@pytest.mark.slow
def test_motions_are_clips_of_both_skills(chain):
    motions = read_artifact(chain.store.newest("tiny", "generate"), "lacoloco/motions")
    assert motions.robot == "solo12"
    assert motions.seed == 0
    assert motions.command == "lacoloco generate --run tiny --preset smoke --quiet"


@pytest.mark.slow
def test_train_low_answers_with_speed_and_figures(chain):
    answer = chain.answer("train-low", "--disc", "gan", "--no-cat", *SMOKE)
    assert {"artifact", "samples", "samples_per_second", "seed"} <= set(answer)
    assert answer["method"] == "gan"
    header = read_header(chain.store.newest("tiny", "train-low"))
    assert header.config["ase"]["discriminator"] == "gan"
    assert header.config["cat"] is False


@pytest.mark.slow
def test_discriminator_that_does_not_exist_is_refused(chain):
    result = chain.invoke("train-low", "--disc", "wgan", *SMOKE)
    assert result.exit_code == 2
    assert "gan or drail" in result.stderr


@pytest.mark.slow
def test_high_level_stands_on_the_low_level_of_its_seed(chain):
    chain.answer("train-low", "--seed", "3", "--run", "seeds", "--motions",
                 str(chain.store.newest("tiny", "generate")), *SMOKE)  # fmt: skip
    chain.answer("train-low", "--seed", "4", "--motions",
                 str(chain.store.newest("tiny", "generate")), *SMOKE)  # fmt: skip
    chain.answer("train-high", "--seed", "3", *SMOKE)
    chain.answer("train-high", "--seed", "7", *SMOKE)
    parents = [
        read_header(path).parents[0].locate(path).parent.name
        for path in chain.store.all("seeds", "train-high")
    ]
    assert parents == ["0001", "0002"]  # seed 3 by its seed; seed 7 has none and takes the newest
    chain.store.use("tiny")


@pytest.mark.slow
def test_eval_of_one_policy(chain):
    answer = chain.answer("eval", *SMOKE)
    (row,) = answer["rows"]
    expected = {"method", "seed", "episodes", "ee_error_mean_m", "ee_error_std_m"}
    assert expected | {"contact_violation_pct", "falls_pct"} <= set(row)
    assert answer["best"] == row
    assert (answer["seeds_found"], answer["seeds_asked"]) == (1, 1)


@pytest.mark.slow
def test_eval_says_loudly_when_seeds_are_missing_and_trains_them_if_asked(chain):
    asked = ("eval", "--seeds", "2", *SMOKE)
    result = chain.invoke(*asked)
    assert result.exit_code == 0, result.stderr
    assert "WARNING: 1 of 2 seeds" in result.stderr
    assert "--seeds 2 --train-missing" in result.stderr
    answer = chain.answer(*asked, "--train-missing")
    assert (answer["seeds_found"], answer["seeds_asked"]) == (2, 2)
    assert [row["seed"] for row in answer["rows"]] == [0, 1]
    old, new = (read_header(path) for path in chain.store.all("tiny", "train-high")[-2:])
    assert new.seed == 1
    assert new.config == old.config
    again = chain.answer(*asked)
    assert (again["seeds_found"], "train_missing" in again) == (2, False)


@pytest.mark.slow
def test_eval_episodes(chain):
    answer = chain.answer("eval", "--episodes", "5", *SMOKE)
    assert answer["rows"][0]["episodes"] == 5


@pytest.mark.slow
def test_export_takes_the_best_of_the_newest_evaluation(chain):
    evaluation = chain.answer("eval", "--seeds", "2", "--train-missing", *SMOKE)
    answer = chain.answer("export", *SMOKE)
    assert answer["max_abs_difference"] <= 1e-5
    assert set(answer["onnx"]) == {"low", "high"}
    parent = read_header(chain.store.newest("tiny", "export")).parents[0]
    policy = parent.locate(chain.store.newest("tiny", "export"))
    assert read_header(policy).seed == evaluation["best"]["seed"]


@pytest.mark.parametrize("verb", ["train-low", "train-high", "eval", "export"])
def test_missing_input_names_the_verb_that_makes_it(tmp_path, verb):
    result = Chain(tmp_path / "runs").invoke(verb, "--run", "new", *SMOKE)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert "lacoloco" in result.stderr and "--run" in result.stderr


@pytest.mark.parametrize("verb", ["generate", "train-low", "train-high", "eval", "export"])
def test_misspelt_key_and_preset_are_refused_before_anything_is_done(tmp_path, verb):
    chain = Chain(tmp_path / "runs")
    for wrong in (["--set", "sede=1"], ["--preset", "smok"]):
        result = chain.invoke(verb, *wrong)
        assert result.exit_code == 2, result.output
        assert result.stderr.count("\n") == 1
    assert not chain.store.root.exists()


@pytest.mark.slow
def test_a_training_goes_on_elsewhere_from_one_file(chain, monkeypatch, tmp_path):
    from lacoloco.pipelines.low_level.trainer import LowTrainer
    from lacoloco.pipelines.training import loop as training

    real, calls = LowTrainer.iterate, []

    def interrupt_the_third(trainer, progress):
        calls.append(progress)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(trainer, progress)

    monkeypatch.setattr(LowTrainer, "iterate", interrupt_the_third)
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", -1.0)
    motions = str(chain.store.newest("tiny", "generate"))
    typed = ("train-low", "--run", "here", "--seed", "6", "--disc", "gan", "--motions", motions)
    assert chain.invoke(*typed, *SMOKE).exit_code == 130
    (left,) = chain.store.partials("here", "train-low")
    (checkpoint,) = left.path.glob("*.checkpoint.h5")
    monkeypatch.setattr(LowTrainer, "iterate", real)

    there = Chain(tmp_path / "runs")
    answer = there.answer(
        "train-low", "--run", "there", "--motions", motions, "--checkpoint", str(checkpoint)
    )
    assert (answer["seed"], answer["method"], answer["samples"]) == (6, "gan-cat", 16 * 8 * 3)
    made = there.store.newest("there", "train-low")
    assert len((made.parent / "metrics.jsonl").read_text().splitlines()) == 1, (
        "two of three were done"
    )
    straight = chain.answer(*typed[:2], "straight", *typed[3:], *SMOKE)
    assert answer["discriminator"] == straight["discriminator"]
    refused = there.invoke("train-high", "--run", "there", "--checkpoint", str(checkpoint))
    assert refused.exit_code == 2 and "no checkpoint of train-high" in refused.stderr


@pytest.mark.slow
def test_interrupted_training_goes_on_where_it_stopped(chain, monkeypatch):
    from lacoloco.pipelines.low_level.trainer import LowTrainer

    real, calls = LowTrainer.iterate, []

    def interrupt_the_second(trainer, progress):
        calls.append(progress)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(trainer, progress)

    monkeypatch.setattr(LowTrainer, "iterate", interrupt_the_second)
    typed = ("train-low", "--run", "tiny", "--seed", "5", "--set", "cat=false", *SMOKE)
    before = chain.store.all("tiny", "train-low")
    result = chain.invoke(*typed)
    assert result.exit_code == 130
    assert "lacoloco train-low --run tiny --resume" in result.stderr
    assert chain.store.all("tiny", "train-low") == before
    begun_on = chain.store.newest("tiny", "generate")
    newer = chain.answer("generate", "--seed", "9", *SMOKE)["artifact"]
    refused = chain.invoke("train-low", "--resume", "--motions", newer)
    assert refused.exit_code == 2 and "the input was" in refused.stderr
    answer = chain.answer("train-low", "--resume")
    assert (answer["seed"], answer["method"]) == (5, "drail")
    assert len(chain.store.all("tiny", "train-low")) == len(before) + 1
    made = chain.store.newest("tiny", "train-low")
    assert read_header(made).parents[0].locate(made) == begun_on, "not the newer motions"


@pytest.mark.slow
@pytest.mark.parametrize("stopped_in", ["training", "recording"])
def test_interrupted_generation_goes_on_with_the_experts_it_trained(
    tmp_path, monkeypatch, stopped_in
):
    from lacoloco.pipelines import generate
    from lacoloco.pipelines.generation.expert_trainer import ExpertTrainer

    chain = Chain(tmp_path / "runs")
    real, iterations = ExpertTrainer.iterate, []

    def interrupt(*_):
        raise KeyboardInterrupt

    def count(trainer, progress):
        iterations.append(progress)
        if stopped_in == "training" and len(iterations) == 2:
            interrupt()
        return real(trainer, progress)

    monkeypatch.setattr(ExpertTrainer, "iterate", count)
    with monkeypatch.context() as patch:
        if stopped_in == "recording":
            patch.setattr(generate, "record", interrupt)
        typed = ("generate", "--run", "tiny", "--retrain", "--set", "walk_clips=1")
        stopped = chain.invoke(*typed, *SMOKE)
    assert stopped.exit_code == 130
    assert "lacoloco generate --run tiny --resume" in stopped.stderr
    once = len(iterations) if stopped_in == "recording" else None
    refused = chain.invoke("generate", "--resume", "--set", "walk_clips=2")
    assert refused.exit_code == 2 and "walk_clips was 1, is 2" in refused.stderr
    assert chain.answer("generate", "--resume")["clips"] == 3
    assert once in (None, len(iterations)), "the experts are not trained again"
    assert len(chain.store.all("tiny", "experts")) == len(chain.store.all("tiny", "generate")) == 1
    assert not chain.store.partials("tiny", "experts") + chain.store.partials("tiny", "generate")


@pytest.mark.slow
def test_what_is_published_is_used_by_its_name(chain, tmp_path, monkeypatch):
    """From a run's artifacts to names that another runs folder, on another machine, starts from."""
    folder = tmp_path / "published"
    folder.mkdir()
    shutil.copy(published.find("solo12-experts"), folder)
    monkeypatch.setattr(published, "FOLDER", folder)
    high, low, motions = (
        chain.store.all("tiny", stage)[0] for stage in ("train-high", "train-low", "generate")
    )
    for path, name in ((high, "solo12-synthetic"), (low, "tiny-low"), (motions, "tiny-motions")):
        assert chain.answer("runs", "publish", str(path), name)["name"] == name
    new = Chain(tmp_path / "runs")
    answer = new.answer("run", "quickstart", *SMOKE)
    assert [stage["stage"] for stage in answer["stages"]] == [
        "train-high",
        "eval",
        "export",
        "play",
    ]
    low_of = read_header(new.store.newest("quickstart", "train-high")).parents[0]
    assert low_of.path == "published:solo12-synthetic.h5"
    (row,) = new.answer("eval", "--policy", "solo12-synthetic", *SMOKE)["rows"]
    assert row["policy"] == str(folder / "solo12-synthetic.h5")
    trained = new.answer("train-high", "--low", "tiny-low", *SMOKE)
    assert trained["method"] == "drail-cat"
    page = tmp_path / "page.html"
    played = new.answer("play", "solo12-synthetic", "--html", str(page), *SMOKE)
    assert played["recordings"] == ["episode 1"]
    assert new.answer("play", "tiny-low", *SMOKE)["recordings"] == ["latent 1 of seed 0"]
    figure = str(tmp_path / "figure.png")
    switching = new.answer("play", "solo12-synthetic", "--figure", figure, *SMOKE)
    assert 0.0 <= switching["walk_first_reach_last"] <= 1.0
    again = new.answer("switching", "--policy", "solo12-synthetic", *SMOKE)
    assert again["walk_first_reach_last"] == switching["walk_first_reach_last"]
    assert Path(again["picture"]).is_file()
    shown = new.answer("runs", "show", "solo12-synthetic")["artifacts"][0]["lineage"]
    assert [row["state"] for row in shown] == ["ok"] * 4, "high, low, motions, experts"


@pytest.mark.slow
def test_the_low_level_learns_from_what_a_robot_made_of_a_dogs_motions(tmp_path):
    chain = Chain(tmp_path / "runs")
    assert chain.invoke("track", "--run", "dog", *SMOKE).exit_code == 2, (
        "there is nothing to follow yet"
    )
    chain.answer("retarget", "--run", "dog", "--trim", "0s:2s", *SMOKE)
    assert chain.answer("track", *SMOKE)["segments"] >= 1
    chain.answer("train-low", *SMOKE)
    parents = str(read_header(chain.store.newest("dog", "train-low")).parents)
    assert "track" in parents and "retarget" not in parents, "not from both"
    told = "has not followed the newest retargeted motions"
    assert told not in chain.invoke("train-low", "--run", "dog", "--preset", "smoke").stderr
    chain.answer("retarget", "--run", "dog", "--trim", "0s:1s", *SMOKE)
    assert told in chain.invoke("train-low", "--run", "dog", "--preset", "smoke").stderr
