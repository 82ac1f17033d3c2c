"""The whole low-level training over two processes: other worlds, one set of weights."""

import sys
from dataclasses import replace

import pytest
import torch

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.benchmarks.throughput import made_up_clips
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.low_level.trainer import LowTrainer
from lacoloco.pipelines.train_low import shared, smoke
from lacoloco.robots.registry import load_robot

MODULES = ("actor", "critic", "discriminator", "encoder", "normalizer")
OPTIMIZERS = ("optimizer", "discriminator_optimizer", "encoder_optimizer")


def work(path):
    """One process: behaviour cloning and three iterations."""
    with parallel.group("cpu"):
        spec = load_robot("solo12")
        clips = made_up_clips(spec, 2, seconds=1.0)
        config = shared(replace(smoke(), cat_ramp=(0.0, 0.5)))
        seed = parallel.own_seed(0)
        trainer = LowTrainer(spec, MotionLibrary(clips), config, seed=seed, device="cpu")
        trainer.pretrain()
        metrics = [trainer.iterate(progress) for progress in (0.0, 0.4, 0.8)]
        algorithm = trainer.algorithm
        state = {name: getattr(algorithm, name).state_dict() for name in (*MODULES, *OPTIMIZERS)}
        state["embedding"] = trainer.start.embedding.state_dict()
        result = {
            "state": {**state, "c_max": trainer.terminations.state_dict()},
            "worlds": trainer.env.physics.qpos,
            "falls": [row["falls_per_1000_steps"] for row in metrics],
        }
        torch.save(result, f"{path}.{parallel.rank()}")


def tensors(state, prefix=""):
    items = state.items() if isinstance(state, dict) else enumerate(state)
    for name, value in items:
        if torch.is_tensor(value):
            yield f"{prefix}/{name}", value
        elif isinstance(value, dict | list):
            yield from tensors(value, f"{prefix}/{name}")


@pytest.mark.slow
def test_two_processes_have_other_worlds_and_the_same_weights_bit_for_bit(tmp_path, processes):
    assert processes.wait(processes.start(__file__, 2, str(tmp_path / "two"))) == [0, 0]
    first, second = processes.results(tmp_path / "two", 2)
    ours, theirs = dict(tensors(first["state"])), dict(tensors(second["state"]))
    assert ours.keys() == theirs.keys() and len(ours) > 60
    for name, value in ours.items():
        assert torch.equal(value, theirs[name]), name
    assert len(first["worlds"]) == smoke().worlds // 2
    assert not torch.allclose(first["worlds"], second["worlds"], atol=1e-3)
    assert first["falls"] == second["falls"], "metrics are those of all worlds"


def test_every_process_does_its_part(monkeypatch):
    whole = replace(smoke(), worlds=16, samples=4800)
    assert shared(whole) == whole
    monkeypatch.setattr(parallel, "size", lambda: 4)
    part = shared(whole)
    assert (part.worlds, part.samples, part.ase.batch) == (4, 1200, whole.ase.batch // 4)
    assert part.ppo == whole.ppo
    with pytest.raises(StageError, match="18 cannot be shared equally by 4 processes"):
        shared(replace(whole, worlds=18))


if __name__ == "__main__":
    torch.set_num_threads(1)
    work(*sys.argv[1:])
