"""Two gloo processes with half of the worlds each learn what one process with all of them learns.

The same random worlds are learned from by one process and by two that share them: the two must end
with the same weights to the last bit, and with those of the one up to rounding.
"""

import sys

import pytest
import torch
from tensordict import TensorDict

from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.learn.ase import Ase, AseConfig
from lacoloco.pipelines.learn.cat import SoftTerminations
from lacoloco.pipelines.learn.gan import GanConfig
from lacoloco.pipelines.learn.latents import project
from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.learn.ppo import Ppo, PpoConfig

WORLDS, HORIZON, ITERATIONS, OBS, ACTIONS, LATENT = 16, 8, 4, 6, 3, 2
PPO = PpoConfig(horizon=HORIZON, epochs=3, minibatches=1, learning_rate=1e-3)
"""One minibatch per epoch: how the samples are shuffled then does not matter."""
NETWORKS = NetworkConfig(actor=(16,), critic=(16,))
WIDER = torch.where(torch.arange(WORLDS) < WORLDS // 2, 1.0, 6.0)[None, :, None]
"""The second process's worlds differ from the first's: a KL or an accuracy of its own would lead it
elsewhere.
"""


def learn_control(mine, generator):
    """PPO under a constraint, on worlds ``mine`` of those that ``draw`` makes up."""
    count = mine.stop - mine.start
    algorithm = Ppo({"policy": OBS}, ACTIONS, count, PPO, NETWORKS)
    terminations = SoftTerminations({"force": 0.5})
    for _ in range(ITERATIONS):
        obs = (torch.randn(HORIZON + 1, WORLDS, OBS, generator=generator) * WIDER)[:, mine]
        noise = torch.randn(HORIZON, WORLDS, ACTIONS, generator=generator)[:, mine]
        margin = torch.randn(HORIZON, WORLDS, 2, generator=generator)[:, mine]
        fell = (torch.rand(HORIZON, WORLDS, generator=generator) < 0.1)[:, mine]
        for step in range(HORIZON):
            algorithm.act(groups(obs[step]))
            action = explore(algorithm, noise[step])
            delta = terminations({"force": margin[step]}, 1.0)
            timed_out = torch.zeros_like(fell[step])
            algorithm.record(action.sum(-1), fell[step], timed_out, groups(obs[step + 1]), delta)
        algorithm.compute_returns(groups(obs[-1]))
        algorithm.update()
    return {
        "actor": algorithm.actor.state_dict(),
        "critic": algorithm.critic.state_dict(),
        "c_max": terminations.state_dict(),
        "rate": {"actor": algorithm.learning_rate},
    }


def learn_style(mine, generator):
    """Discriminator and encoder; every batch takes each of the rollout's transitions, none from
    memory, once.
    """
    count = mine.stop - mine.start
    examples = torch.Generator().manual_seed(11)

    def demonstrations(rows):
        if rows == 1:  # only to see how wide they are
            return torch.zeros(1, 4)
        # All of a batch's demonstrations, of which every process takes its part.
        whole = rows * WORLDS // count
        rolled = torch.randn(whole, 4, generator=examples) * 0.5 + 1.0
        return rolled[mine.start * whole // WORLDS :][:rows]

    ase = Ase(
        {"policy": OBS, "latent": LATENT},
        ACTIONS,
        count,
        demonstrations,
        ppo=PPO,
        networks=NETWORKS,
        ase=AseConfig(
            discriminator="gan",
            # An accuracy that the second half exceeds, but not both together; noise that is each
            # process's own.
            gan=GanConfig(hidden=(16,), noise=0.0, max_accuracy=0.65),
            encoder_hidden=(16,),
            updates=6,
            batch=2 * HORIZON * count,
            diversity=0.0,
            learning_rate=1e-3,
        ),
        seed=parallel.own_seed(0),
    )
    # Instead of the process's own memory: as many zeros again, the same for all.
    ase.replay.sample = lambda rows: torch.zeros(rows, 4)
    for _ in range(ITERATIONS):
        older = torch.randn(HORIZON, WORLDS, 2, generator=generator) * 0.5 + 1.0
        older = torch.where(WIDER > 1.0, older - 4.0, older)[:, mine]  # half of it is easily told
        obs = torch.randn(HORIZON + 1, WORLDS, OBS, generator=generator)[:, mine]
        z = project(torch.randn(HORIZON + 1, WORLDS, LATENT, generator=generator))[:, mine]
        noise = torch.randn(HORIZON, WORLDS, ACTIONS, generator=generator)[:, mine]
        nobody = torch.zeros(count, dtype=torch.bool)
        for step in range(HORIZON):
            ase.act(groups(obs[step], z[step]))
            explore(ase, noise[step])
            newer = older[step] + 0.3 * z[step]
            ase.record_transition(older[step], newer, ~nobody)
            ase.record(torch.zeros(count), nobody, nobody, groups(obs[step + 1], z[step + 1]))
        ase.compute_returns(groups(obs[-1], z[-1]))
        ase.update()
    modules = ("actor", "critic", "discriminator", "encoder", "normalizer")
    return {name: getattr(ase, name).state_dict() for name in modules}


def groups(policy, latent=None):
    """Observations as a learner takes them."""
    parts = {"policy": policy} if latent is None else {"policy": policy, "latent": latent}
    return TensorDict(parts, batch_size=[len(policy)])


def explore(algorithm, noise):
    """Act by given random numbers, so that a world's action does not depend on who simulates it."""
    mean, std = algorithm.transition.distribution_params
    action = mean + std * noise
    algorithm.transition.actions = action
    distribution = torch.distributions.Normal(mean, std)
    algorithm.transition.actions_log_prob = distribution.log_prob(action).sum(-1)
    return action


def work(path, what):
    """One process: learn from its share of the worlds and save what came out."""
    with parallel.group("cpu"):
        count = parallel.share(WORLDS)
        mine = slice(parallel.rank() * count, (parallel.rank() + 1) * count)
        torch.manual_seed(parallel.rank())  # first weights that differ, unless they are exchanged
        learn = {"control": learn_control, "style": learn_style}[what]
        torch.save(learn(mine, torch.Generator().manual_seed(7)), f"{path}.{parallel.rank()}")


def flat(state):
    """Every number of a state, in order."""
    return torch.cat(
        [tensor.double().flatten() for part in state.values() for tensor in part.values()]
    )


@pytest.mark.slow
@pytest.mark.parametrize("what", ["control", "style"])
def test_two_processes_learn_what_one_does(tmp_path, processes, what):
    alone, together = tmp_path / "one", tmp_path / "two"
    running = [
        processes.start(__file__, 1, str(alone), what),
        processes.start(__file__, 2, str(together), what),
    ]
    assert [processes.wait(each) for each in running] == [[0], [0, 0]]
    (one,) = processes.results(alone, 1)
    first, second = processes.results(together, 2)
    assert torch.equal(flat(first), flat(second)), "one set of weights, bit for bit"
    assert torch.allclose(flat(first), flat(one), atol=5e-4)
    torch.manual_seed(0)
    if what == "control":
        before = Ppo({"policy": OBS}, ACTIONS, 1, PPO, NETWORKS).critic.state_dict()
        moved = (one["critic"]["mlp.0.weight"] - before["mlp.0.weight"]).abs().max()
        assert float(moved) > 20 * 5e-4, "there was something to learn"


def test_alone_nothing_is_exchanged():
    values = torch.tensor([1.0, 2.0, 6.0])
    assert parallel.average(values) is values
    assert parallel.maximum(values) is values
    assert parallel.share(7) == 7
    assert parallel.own_seed(5) == 5
    assert parallel.settings() is None
    assert parallel.from_first("here") == "here"
    assert parallel.any_process(True, "cpu") and not parallel.any_process(False, "cpu")
    assert [float(x) for x in parallel.mean_and_std(values)] == pytest.approx([3.0, 7.0**0.5])


def test_worlds_are_shared_equally_or_not_at_all(monkeypatch):
    monkeypatch.setattr(parallel, "size", lambda: 3)
    assert parallel.share(12) == 4
    with pytest.raises(ValueError, match="16 .* 3 processes"):
        parallel.share(16)


if __name__ == "__main__":
    torch.set_num_threads(1)
    work(*sys.argv[1:])
