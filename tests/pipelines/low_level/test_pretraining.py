"""A pretraining tells how far it is, and goes on after the last round that it finished."""

from dataclasses import replace

import pytest
import torch

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines import generate
from lacoloco.pipelines.generation.config import smoke_expert
from lacoloco.pipelines.generation.expert_trainer import ExpertTrainer
from lacoloco.pipelines.generation.recorder import record
from lacoloco.pipelines.low_level import trainer as low_level
from lacoloco.pipelines.low_level.expert_labels import ExpertLabels
from lacoloco.pipelines.stage import Silent, StageContext
from lacoloco.pipelines.train_low import smoke
from lacoloco.pipelines.training.checkpoint import (
    checkpoint_path,
    restore_checkpoint,
    save_checkpoint,
)
from lacoloco.pipelines.training.pretraining import KeptPretraining

ROUNDS, STEPS, SECONDS = 2, 4, 0.2
ROUND = STEPS // 2 + round(SECONDS / 0.02)
"""Gradient steps before the experts are asked, and control steps in which they are."""


class Told(Silent):
    def __init__(self):
        self.total, self.done, self.metrics, self.said = 0, [], {}, []

    def start(self, description, total):
        self.total = total

    def advance(self, done, **metrics):
        self.done.append(done)
        self.metrics |= metrics

    def say(self, line):
        self.said.append(line)


@pytest.fixture
def context(tmp_path):
    return StageContext(RunStore(tmp_path / "runs"), "run")


@pytest.fixture
def make_trainer(solo12, context, monkeypatch):
    """Factory of trainers that ask an untrained expert about two short clips of its own."""
    monkeypatch.setattr(
        low_level, "latent_switching_robustness", lambda *_, **__: {"switching_fall_rate": 0.5}
    )
    expert = ExpertTrainer(solo12, "walk", smoke_expert(), seed=0, device="cpu").policy()
    config = replace(generate.smoke(), seconds=SECONDS)
    library = MotionLibrary(record(solo12, "walk", expert, 2, config, context)[0])
    config = replace(smoke(), bc_steps=STEPS, expert_rounds=ROUNDS, expert_worlds=4)

    def factory(label_weight=0.0):
        own = replace(config, ase=replace(config.ase, label_weight=label_weight))
        return low_level.LowTrainer(
            solo12, library, own, seed=0, device="cpu", experts={"walk": expert}
        )

    return factory


def pretrained(trainer, context, path):
    """What it came to, its state, and what was told."""
    told = Told()
    log = KeptPretraining(replace(context, progress=told), path, {})
    metrics = trainer.pretrain(log)
    return metrics, told


def test_an_interrupted_pretraining_goes_on_after_its_last_round(
    make_trainer, context, tmp_path, monkeypatch
):
    straight = make_trainer()
    expected, told = pretrained(straight, context, checkpoint_path(tmp_path, "straight"))
    assert told.total == told.done[-1] == ROUNDS * ROUND + 2 * STEPS
    assert told.done == sorted(told.done) and told.said == []
    assert {"round", "loss", "falls_per_1000_steps"} <= set(told.metrics)
    assert told.metrics["round"] == ROUNDS + 1
    assert told.metrics["loss"] == pytest.approx(expected["clone_error"], rel=1.0)

    asked, collect = [], ExpertLabels.collect

    def interrupted(labels, *arguments):
        asked.append(labels)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return collect(labels, *arguments)

    monkeypatch.setattr(ExpertLabels, "collect", interrupted)
    path = checkpoint_path(tmp_path, "broken")
    with pytest.raises(KeyboardInterrupt):
        pretrained(make_trainer(), context, path)
    torch.manual_seed(1234)
    resumed = make_trainer()
    metrics, told = pretrained(resumed, context, path)
    assert len(asked) == 3, "the first round is not repeated"
    assert told.said == ["going on after round 1 of 3"]
    assert told.done[0] == ROUND and told.done[-1] == told.total
    assert metrics == expected
    networks = [
        (t.algorithm.actor, t.start.embedding, t.algorithm.encoder) for t in (straight, resumed)
    ]
    for one, other in zip(*networks, strict=True):
        for name, value in one.state_dict().items():
            assert torch.equal(value, other.state_dict()[name]), name

    again, told = pretrained(make_trainer(), context, path)
    assert again == expected and len(asked) == 3, "nothing was left but the encoder"


def test_a_training_that_is_held_to_answers_goes_on_with_them(make_trainer, context, tmp_path):
    """Its checkpoint holds the answers: a resumed training takes the same step."""
    trainer = make_trainer(label_weight=1.0)
    trainer.pretrain()
    path = checkpoint_path(tmp_path, "held")
    save_checkpoint(trainer, path, 1, 0.0, {}, context, {})
    expected = trainer.iterate(0.5)
    resumed = make_trainer(label_weight=1.0)
    assert restore_checkpoint(resumed, path, seed=0)[0] == 1
    metrics = resumed.iterate(0.5)
    assert expected["label"] > 0.0 and metrics["label"] == expected["label"]
    names = ("surrogate", "value", "kl", "diversity")
    assert [metrics[name] for name in names] == [expected[name] for name in names]


def test_without_a_weight_no_answer_is_kept(make_trainer):
    trainer = make_trainer()
    trainer.pretrain()
    assert trainer.algorithm.answers is None and "cloning" not in trainer.state_dict()
    assert not trainer.start.cloning.state_dict()["asked"]
