"""The loop that every training runs in: log, checkpoint, interruption, resumption."""

import json
import os
import signal
from dataclasses import replace

import pytest
import torch

from lacoloco.datasets.artifact import read_artifact
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.store import RunStore, remove_working
from lacoloco.pipelines import train_low
from lacoloco.pipelines.generation.config import smoke_expert
from lacoloco.pipelines.generation.expert_trainer import ExpertTrainer
from lacoloco.pipelines.high_level.trainer import HighTrainer
from lacoloco.pipelines.low_level.trainer import LowTrainer
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.stage import Silent, StageContext
from lacoloco.pipelines.train_high import smoke as smoke_high
from lacoloco.pipelines.train_low import smoke as smoke_low
from lacoloco.pipelines.training import checkpoint
from lacoloco.pipelines.training import loop as training
from lacoloco.pipelines.training.loop import train
from lacoloco.pipelines.training.metrics_log import MetricsLog


class Walk:
    """A `Trainer` that adds random numbers up; it interrupts itself when told to."""

    samples_per_iteration = 10

    def __init__(self, interrupt_at=None):
        self.total, self.seen, self.interrupt_at = torch.zeros(3), [], interrupt_at

    def iterate(self, progress):
        self.total = self.total + torch.randn(3)
        self.seen.append(progress)
        if len(self.seen) == self.interrupt_at:
            os.kill(os.getpid(), signal.SIGINT)
        return {"sum": float(self.total.sum()), "count": float(len(self.seen))}

    def state_dict(self):
        return {"total": self.total, "seen": self.seen}

    def load_state_dict(self, state):
        self.total, self.seen = state["total"], list(state["seen"])


class Watching(Silent):
    def __init__(self):
        self.calls = []

    def start(self, description, total):
        self.calls.append(("start", description, total))

    def advance(self, done, **metrics):
        self.calls.append(("advance", done, metrics))

    def say(self, line):
        self.calls.append(("say", line))

    def stop(self):
        self.calls.append(("stop",))


@pytest.fixture
def context(tmp_path):
    return StageContext(RunStore(tmp_path / "runs"), "run", seed=7, command="lacoloco x")


def lines(directory):
    return [json.loads(line) for line in (directory / "metrics.jsonl").read_text().splitlines()]


def test_every_iteration_is_logged_and_shown(tmp_path, context):
    progress = Watching()
    context = replace(context, progress=progress)
    metrics = train(Walk(), 3, tmp_path, context, "a walk", shown=("sum", "absent"))
    logged = lines(tmp_path)
    assert [line["samples"] for line in logged] == [10, 20, 30]
    assert [line["training"] for line in logged] == ["a walk"] * 3
    assert [line["count"] for line in logged] == [1.0, 2.0, 3.0]
    assert metrics["samples"] == 30
    assert metrics["sum"] == logged[-1]["sum"]
    assert metrics["samples_per_second"] > 0
    assert progress.calls[0] == ("start", "a walk", 30)
    assert progress.calls[2] == ("advance", 20, {"sum": logged[1]["sum"]})
    assert progress.calls[-1] == ("stop",)
    assert list((tmp_path / "tensorboard").iterdir())


def test_progress_is_the_share_already_done(tmp_path, context):
    trainer = Walk()
    train(trainer, 4, tmp_path, context, "walk")
    assert trainer.seen == [0.0, 0.25, 0.5, 0.75]


def test_an_interrupted_training_goes_on_as_if_nothing_had_been(tmp_path, context):
    whole, straight = Walk(), tmp_path / "straight"
    straight.mkdir()
    torch.manual_seed(3)
    expected = train(whole, 6, straight, context, "walk")

    torch.manual_seed(3)
    with pytest.raises(KeyboardInterrupt):
        train(Walk(interrupt_at=4), 6, tmp_path, context, "walk")
    assert len(lines(tmp_path)) == 4, "the running iteration is finished first"
    checkpoint = read_artifact(tmp_path / "walk.checkpoint.h5", "lacoloco/checkpoint")
    assert checkpoint.metadata["iteration"] == 4
    assert (checkpoint.seed, checkpoint.command) == (7, "lacoloco x")

    torch.manual_seed(99)
    second = Walk()
    metrics = train(second, 6, tmp_path, context, "walk")
    assert metrics["sum"] == expected["sum"]
    assert torch.equal(second.total, whole.total)
    assert second.seen == whole.seen
    assert [line["samples"] for line in lines(tmp_path)] == [10, 20, 30, 40, 50, 60]


def test_checkpoints_are_also_written_as_time_passes(tmp_path, context, monkeypatch):
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", -1.0)
    seen = []

    class Looking(Walk):
        def iterate(self, progress):
            seen.append((tmp_path / "walk.checkpoint.h5").exists())
            return super().iterate(progress)

    train(Looking(), 3, tmp_path, context, "walk")
    assert seen == [False, True, True]


def test_a_resumed_training_first_tells_what_was_done_before(tmp_path, context):
    with pytest.raises(KeyboardInterrupt):
        train(Walk(interrupt_at=4), 6, tmp_path, context, "walk")
    progress = Watching()
    train(Walk(), 6, tmp_path, replace(context, progress=progress), "walk")
    assert progress.calls[:2] == [("start", "walk", 60), ("advance", 40, {})]
    assert progress.calls[2][:2] == ("advance", 50)


def test_a_finished_training_is_not_repeated_by_a_resumed_stage(tmp_path, context):
    """Its stage may be interrupted later, in its next training or while it writes its artifact."""
    first, second = Walk(), Walk()
    before = train(first, 3, tmp_path, context, "walk")
    after = train(second, 3, tmp_path, context, "walk")
    assert (after["sum"], after["samples"]) == (before["sum"], before["samples"])
    assert torch.equal(second.total, first.total)
    assert len(lines(tmp_path)) == 3
    remove_working(tmp_path)
    assert not list(tmp_path.glob("*.checkpoint.h5"))
    assert (tmp_path / "metrics.jsonl").exists()


def test_what_a_killed_training_logged_after_its_checkpoint_is_logged_once(tmp_path, context):
    with pytest.raises(KeyboardInterrupt):
        train(Walk(interrupt_at=2), 4, tmp_path, context, "walk")
    later = [{"training": "walk", "samples": 30, "sum": -1.0}, {"training": "other", "samples": 90}]
    with (tmp_path / "metrics.jsonl").open("a") as log:
        log.write("".join(json.dumps(line) + "\n" for line in later) + '{"training": "wa')
    train(Walk(), 4, tmp_path, context, "walk")
    logged = lines(tmp_path)
    assert [line["samples"] for line in logged] == [10, 20, 90, 30, 40]
    assert logged[2] == later[1]


def test_the_log_of_before_stays_whole_when_a_resume_cannot_write(tmp_path, full_disk):
    log = tmp_path / "metrics.jsonl"
    rows = [{"training": "walk", "samples": 10 * n, "sum": 0.5} for n in range(1, 81)]
    log.write_text("".join(json.dumps(row) + "\n" for row in rows))
    before = log.read_bytes()
    with full_disk(), pytest.raises(ArtifactError, match=r"metrics.jsonl"):
        MetricsLog(tmp_path, "walk", done=790)
    assert log.read_bytes() == before
    assert list(tmp_path.iterdir()) == [log]


def test_warnings_are_said_once_and_those_that_hold_at_the_end_are_returned(tmp_path, context):
    def warn(history):
        names = ["first", "second"] if len(history) == 2 else ["second"] * (len(history) > 1)
        return [f"{name}: after {len(history)}" for name in names]

    progress = Watching()
    context = replace(context, progress=progress)
    metrics = train(Walk(), 4, tmp_path, context, "walk", warn=warn)
    said = [call[1] for call in progress.calls if call[0] == "say"]
    assert said == ["WARNING: first: after 2", "WARNING: second: after 2"]
    assert metrics["warnings"] == ["second: after 4"]


def test_a_resumed_training_is_judged_by_its_whole_history(tmp_path, context):
    def count(history):
        return [f"seen: {[metrics['samples'] for metrics in history]}"]

    with pytest.raises(KeyboardInterrupt):
        train(Walk(interrupt_at=2), 3, tmp_path, context, "walk")
    train(Walk(), 1, tmp_path, context, "another")
    metrics = train(Walk(), 3, tmp_path, context, "walk", warn=count)
    assert metrics["warnings"] == ["seen: [10, 20, 30]"]
    again = train(Walk(), 3, tmp_path, context, "walk", warn=count)
    assert again["warnings"] == metrics["warnings"], "also when nothing was left to train"


def test_ctrl_c_works_as_before_once_the_training_is_over(tmp_path, context):
    before = signal.getsignal(signal.SIGINT)
    train(Walk(), 1, tmp_path, context, "walk")
    assert signal.getsignal(signal.SIGINT) is before


def test_a_second_ctrl_c_acts_at_once(tmp_path, context):
    class Stuck(Walk):
        def iterate(self, progress):
            os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGINT)
            raise AssertionError("not reached")

    with pytest.raises(KeyboardInterrupt):
        train(Stuck(), 1, tmp_path, context, "walk")


def test_two_trainings_share_a_directory(tmp_path, context):
    with pytest.raises(KeyboardInterrupt):
        train(Walk(interrupt_at=1), 2, tmp_path, context, "expert walk")
    train(Walk(), 1, tmp_path, context, "expert reach")
    assert (tmp_path / "expert-walk.checkpoint.h5").exists()
    assert [line["training"] for line in lines(tmp_path)] == ["expert walk", "expert reach"]


@pytest.fixture
def make_trainer(solo12, motions):
    """Factory of the three real trainers in their smallest size."""

    def expert(seed):
        # Short episodes, so that resets and time-outs happen too.
        trainer = ExpertTrainer(solo12, "walk", smoke_expert(), seed=seed, device="cpu")
        trainer.env.steps = trainer.env.episode_steps - 6
        return trainer

    def low(seed, **changes):
        config = replace(smoke_low(), **{"cat_ramp": (0.0, 0.5), **changes})
        trainer = LowTrainer(solo12, motions, config, seed=seed, device="cpu")
        trainer.env.steps = trainer.env.episode_steps - 12
        return trainer

    def gan(seed):
        ase = replace(smoke_low().ase, discriminator="gan")
        return low(seed, ase=ase, cat=False)

    def high(seed):
        trained = low(seed).policy()
        policy = Policy(trained.head, trained.actor)
        trainer = HighTrainer(solo12, policy, smoke_high(), seed=seed, device="cpu")
        trainer.env.env.steps = trainer.env.env.episode_steps - 30
        return trainer

    return {"expert": expert, "low": low, "low-gan": gan, "high": high}.__getitem__


@pytest.mark.parametrize("kind", ["expert", "low", "low-gan", "high"])
def test_resumed_training_equals_an_uninterrupted_one_bit_for_bit(
    kind, make_trainer, tmp_path, context
):
    """Through the file: weights, optimisers, worlds, generators, counters."""
    make, iterations = make_trainer(kind), 4
    straight = make(0)
    metrics = train(straight, iterations, tmp_path, context, "straight")

    first = make(0)
    iterate, count = first.iterate, []

    def interrupted(progress):
        count.append(progress)
        if len(count) == iterations // 2:
            os.kill(os.getpid(), signal.SIGINT)
        return iterate(progress)

    first.iterate = interrupted
    with pytest.raises(KeyboardInterrupt):
        train(first, iterations, tmp_path, context, "broken")
    second = make(0)
    torch.manual_seed(1234)
    resumed = train(second, iterations, tmp_path, context, "broken")

    timing = {"seconds", "samples_per_second"}
    assert {k: v for k, v in resumed.items() if k not in timing} == {
        k: v for k, v in metrics.items() if k not in timing
    }
    for name, ours, theirs in zip_states(second, straight):
        assert torch.equal(ours, theirs), name


def zip_states(first, second):
    """Every tensor of two trainers' states, by name."""
    ours, theirs = flat(first.state_dict()), flat(second.state_dict())
    assert ours.keys() == theirs.keys()
    assert len(ours) > 20
    return [(name, value, theirs[name]) for name, value in ours.items()]


def flat(state, prefix=""):
    if torch.is_tensor(state):
        return {prefix: state}
    items = state.items() if isinstance(state, dict) else enumerate(state)
    found = {}
    for name, value in items:
        if torch.is_tensor(value) or isinstance(value, dict | list | tuple):
            found |= flat(value, f"{prefix}/{name}")
        elif isinstance(value, int | float):
            found[f"{prefix}/{name}"] = torch.tensor(value)
    return found


@pytest.mark.parametrize("kind", ["expert", "low", "high"])
def test_seeds_decide_the_training(kind, make_trainer, tmp_path, context):
    results = [
        train(make_trainer(kind)(seed), 1, tmp_path, context, f"training {index}")
        for index, seed in enumerate((0, 0, 1))
    ]
    assert results[0]["value"] == results[1]["value"] != results[2]["value"]


def test_a_trainings_first_checkpoint_replaces_that_of_its_pretraining(tmp_path, context):
    path, begun = tmp_path / "walk.checkpoint.h5", Walk()
    assert checkpoint.part_of(path) == ""
    begun.total += 1.0
    checkpoint.save_checkpoint(begun, path, 3, 0.0, {}, context, {}, checkpoint.PRETRAINING)
    assert checkpoint.part_of(path) == checkpoint.PRETRAINING
    walk = Walk()
    assert checkpoint.restore_checkpoint(walk, path, 7) == (0, 0.0, {})
    assert not walk.total.any(), "a training does not begin with what its pretraining kept"
    assert checkpoint.restore_checkpoint(walk, path, 7, checkpoint.PRETRAINING)[0] == 3
    assert torch.equal(walk.total, begun.total)
    train(Walk(), 2, tmp_path, context, "walk")
    assert checkpoint.part_of(path) == checkpoint.TRAINING
    assert checkpoint.restore_checkpoint(walk, path, 7, checkpoint.PRETRAINING)[0] == 0
    remove_working(tmp_path)
    assert checkpoint.part_of(path) == ""


def test_a_checkpoint_goes_on_whose_parts_have_their_old_names(tmp_path, context):
    """An unfinished training of before kept its worlds' generator as "draw"."""
    path, before, after = tmp_path / "walk.checkpoint.h5", Walk(), {}
    before.state_dict = lambda: {"env": {"draw": torch.arange(3), "command": torch.ones(2)}}
    checkpoint.save_checkpoint(before, path, 1, 0.0, {}, context, {})
    walk = Walk()
    walk.load_state_dict = after.update
    checkpoint.restore_checkpoint(walk, path, seed=7)
    assert sorted(after["env"]) == ["command", "generator"]
    assert torch.equal(after["env"]["generator"], torch.arange(3))


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["laptop", "gpu"])
def test_a_checkpoint_is_small_enough_to_travel(robot, make_motions, tmp_path, context, preset):
    """With every buffer full; continuing elsewhere takes one file under 16 MB."""
    trainer = LowTrainer(
        robot, make_motions(robot), train_low.PRESETS[preset](), seed=0, device="cpu"
    )
    if preset == "gpu":
        # What MuJoCo Warp keeps; the C engine, which nobody runs this wide, keeps three times more.
        state = (trainer.env.physics.qpos, *[trainer.env.physics.qvel] * 3)
        rows = {"rows": torch.cat(state, dim=1).contiguous()}
        trainer.env.physics.state_dict = lambda: rows
        trainer.env.physics.load_state_dict = lambda state: None
    replay = trainer.algorithm.replay
    replay.size = len(replay.data)
    optimizers = [trainer.algorithm.optimizer, trainer.algorithm.discriminator_optimizer]
    for optimizer in (*optimizers, trainer.algorithm.encoder_optimizer):
        for group in optimizer.param_groups:
            for parameter in group["params"]:
                parameter.grad = torch.zeros_like(parameter)
        optimizer.step()
    path = tmp_path / "large.checkpoint.h5"
    checkpoint.save_checkpoint(trainer, path, 1, 0.0, {}, context, {})
    assert 1e6 < path.stat().st_size < 16e6
    checkpoint.restore_checkpoint(trainer, path, seed=0)
