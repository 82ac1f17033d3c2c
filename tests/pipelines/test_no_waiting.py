"""During a rollout nothing on the host waits for the device: no step reads a tensor's value.

Where there is a GPU, torch itself says so. Everywhere else the same code is run the way it runs on
a GPU (worlds chosen by masks instead of numbers) on the CPU, and every operation that needs a
tensor's value on the host is refused.
"""

from dataclasses import replace

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines import train_high
from lacoloco.pipelines.benchmarks.throughput import made_up_clips
from lacoloco.pipelines.generation import expert_trainer as experts
from lacoloco.pipelines.generation.config import smoke_expert
from lacoloco.pipelines.generation.expert_trainer import ExpertTrainer
from lacoloco.pipelines.high_level import trainer as high_level
from lacoloco.pipelines.high_level.trainer import HighTrainer
from lacoloco.pipelines.learn import latents, ppo
from lacoloco.pipelines.learn.ppo import PpoConfig
from lacoloco.pipelines.low_level.trainer import LowTrainer
from lacoloco.pipelines.sim import env
from lacoloco.pipelines.sim import episode_restarts as restarts
from lacoloco.pipelines.train_low import smoke as smoke_low

READS = (
    torch.ops.aten._local_scalar_dense.default,
    torch.ops.aten.is_nonzero.default,
    torch.ops.aten.nonzero.default,
    torch.ops.aten.masked_select.default,
    torch.ops.aten.equal.default,
    torch.ops.aten._unique2.default,
)
"""Operations whose result, or its size, the host must wait for; besides these, indexing by a
mask.
"""
BY_MASK = (
    torch.ops.aten.index.Tensor,
    torch.ops.aten.index_put_.default,
    torch.ops.aten.index_put.default,
)


class NoReads(TorchDispatchMode):
    """Refuses to read a tensor's value while it is watching."""

    def __init__(self):
        super().__init__()
        self.watching, self.seen = False, 0

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        if self.watching:
            self.seen += 1
            chosen = args[1] if func in BY_MASK else ()
            by_mask = any(index is not None and index.dtype == torch.bool for index in chosen)
            assert func not in READS and not by_mask, f"{func} waits for the device"
        return func(*args, **(kwargs or {}))


def watch_rollout(trainer, on, off):
    """Call ``on`` when a rollout begins, with its first action, and ``off`` when its returns are
    due.
    """
    act, compute = trainer.algorithm.act, trainer.algorithm.compute_returns

    def acting(obs):
        on()
        return act(obs)

    def computing(obs):
        off()
        return compute(obs)

    trainer.algorithm.act, trainer.algorithm.compute_returns = acting, computing


def exempt(physics, mode):
    """The native engine lives on the host: what it reads there is not waited for."""

    def unwatched(call):
        def inside(*arguments):
            before, mode.watching = mode.watching, False
            result = call(*arguments)
            mode.watching = before
            return result

        return inside

    for name in ("step", "reset", "push"):
        setattr(physics, name, unwatched(getattr(physics, name)))


def busy(base):
    """Episodes that end, targets that change and pushes that come within a few steps."""
    task = replace(base.task, episode_s=0.08)
    if task.randomisation.push:
        task = replace(
            task, randomisation=replace(task.randomisation, push_interval_s=(0.02, 0.06))
        )
    if task.resample_s:
        task = replace(task, resample_s=(0.02, 0.06))
    base.task, base.episode_steps = task, torch.full_like(base.episode_steps, task.episode_steps)
    base._push_at.fill_(2)
    return base


@pytest.fixture
def make_trainer(solo12, monkeypatch):
    """Factory of the three trainers, choosing worlds by masks as on a GPU."""

    def factory(kind, device="cpu"):
        if device == "cpu":
            for module in (env, latents, ppo, restarts):
                monkeypatch.setattr(module, "select", lambda mask: mask)
            for module in (experts, high_level):
                monkeypatch.setattr(module, "perhaps_any", lambda mask: True)
        library = MotionLibrary(made_up_clips(solo12, 2, seconds=1.0), device=device)
        config = replace(smoke_low(), cat_ramp=(0.0, 0.5), worlds=8)
        low = LowTrainer(solo12, library, config, seed=0, device=device)
        if kind == "low":
            return low, busy(low.env)
        if kind == "high":
            small = replace(train_high.smoke(), worlds=8)
            high = HighTrainer(solo12, low.policy(), small, seed=0, device=device)
            return high, busy(high.env.env)
        config = replace(
            smoke_expert(), worlds=8, ppo=PpoConfig(horizon=8, epochs=1, minibatches=1)
        )
        expert = ExpertTrainer(solo12, kind, config, seed=0, device=device)
        return expert, busy(expert.env)

    return factory


def rollouts_without_reads(trainer, base, engine_is_exempt):
    mode = NoReads()
    watch_rollout(
        trainer,
        lambda: setattr(mode, "watching", True),
        lambda: setattr(mode, "watching", False),
    )
    if engine_is_exempt:
        exempt(base.physics, mode)
    resets = []
    reset = base.reset
    base.reset = lambda mask: (resets.append(mask.clone()), reset(mask))[1]
    with mode:
        for progress in (0.0, 0.9):
            trainer.iterate(progress)
    assert mode.seen > 100, "the rollout was watched"
    assert any(bool(mask.any()) for mask in resets), "worlds were reset, too"


@pytest.mark.parametrize("kind", ["walk", "reach_in_place", "low", "high"])
def test_no_step_of_a_rollout_reads_a_value(make_trainer, kind):
    rollouts_without_reads(*make_trainer(kind), engine_is_exempt=True)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["low", "high"])
def test_neither_does_the_warp_engine(make_trainer, kind, monkeypatch):
    warp = pytest.importorskip("lacoloco.pipelines.sim.mujoco_warp", reason="needs MuJoCo Warp")
    monkeypatch.setenv("LACOLOCO_PHYSICS", "warp")
    # Its look at the overflow flags reads memory of the host that was filled long before.
    monkeypatch.setattr(warp, "LOOK_EVERY", 10**9)
    rollouts_without_reads(*make_trainer(kind), engine_is_exempt=False)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("kind", ["walk", "reach_in_place", "low", "high"])
def test_cuda_sees_no_synchronisation(make_trainer, kind):
    trainer, _ = make_trainer(kind, "cuda")
    trainer.iterate(0.0)  # compiles kernels and captures the graph
    watch_rollout(
        trainer,
        lambda: torch.cuda.set_sync_debug_mode("error"),
        lambda: torch.cuda.set_sync_debug_mode("default"),
    )
    try:
        for progress in (0.0, 0.9):
            trainer.iterate(progress)
    finally:
        torch.cuda.set_sync_debug_mode("default")


@pytest.mark.parametrize(
    "read",
    [
        lambda x: float(x.sum()),
        lambda x: bool(x.any()),
        lambda x: torch.nonzero(x),
        lambda x: x[x > 0],
    ],
)
def test_a_read_would_be_noticed(read):
    mode = NoReads()
    mode.watching = True
    with mode, pytest.raises(AssertionError, match="waits for the device"):
        read(torch.ones(3))
