"""PPO on rsl_rl's models and storage, with soft terminations, true time-outs and a deterministic
share of worlds.

rsl_rl stores ``dones`` as bytes and bootstraps time-outs from the state *before* the last step;
this subclass keeps its own float buffers and evaluates the true next state instead. Everything it
learns from is taken before a reset.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict

from lacoloco.datasets.config_values import Factor, LearningRate, PositiveFactor, Share, Within
from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.learn.cat import terminated
from lacoloco.pipelines.learn.exploration import Exploration
from lacoloco.pipelines.learn.networks import NetworkConfig, example, make_actor, make_critic
from lacoloco.pipelines.learn.returns import advantages
from lacoloco.pipelines.masking import pick, put, select

EXPLORE = "explore"
"""Observation group (N, 1): factor on the std that this step's action was sampled with, 0 where it
was the mean.
"""


@dataclass(frozen=True)
class PpoConfig:
    """Optimisation of actor and critic.

    Attributes:
        horizon: Steps per world and iteration.
        epochs: Passes over a rollout.
        minibatches: Minibatches per pass.
        gamma: Discount per step.
        lam: Lambda of the generalised advantage estimation.
        clip: Clipping range of the probability ratio.
        learning_rate: First learning rate of the actor.
        min_learning_rate: Lower limit of the actor's learning rate.
        max_learning_rate: Upper limit of the actor's learning rate.
        critic_learning_rate: Learning rate of the critic. It is fixed, because the critic's loss
            says nothing about the KL.
        desired_kl: Target of the KL per minibatch. The actor's learning rate changes by a factor of
            1.5 to keep it. A trainer may lower it during the training (``Ppo.desired_kl``).
        max_grad_norm: Gradients of actor and critic are clipped to this norm, each by itself.
        bound: Soft limit on the absolute mean action [raw action units].
        bound_weight: Weight of the squared excess over that limit; 0: no limit.
        greedy_fraction: Mean share of steps with the mean action. World i acts on its mean with a
            fixed probability that rises from 0 to 1 over the worlds (the original's code has 0.1).
        noise_hold_steps: Mean number of steps until a world decides again whether and how far it
            explores. In long phases the mean reaches the states that it reaches by itself, above
            all a standstill, and exploration starts there.
        high_noise_fraction: Share of the exploring phases with the larger noise.
    """

    horizon: Annotated[int, Within(1, 10_000)] = 32
    epochs: Annotated[int, Within(1, 1000)] = 5
    minibatches: Annotated[int, Within(1, 10_000)] = 4
    gamma: Share = 0.99
    lam: Share = 0.95
    clip: Annotated[float, Within(0, 10, above=True)] = 0.2
    learning_rate: LearningRate = 2e-4
    min_learning_rate: LearningRate = 1e-5
    max_learning_rate: LearningRate = 2e-3
    critic_learning_rate: LearningRate = 1e-3
    desired_kl: Annotated[float, Within(0, 100, above=True)] = 0.01
    max_grad_norm: PositiveFactor = 1.0
    bound: Factor = 1.1
    bound_weight: Factor = 0.0
    greedy_fraction: Share = 0.0
    noise_hold_steps: Annotated[float, Within(1, 1e6)] = 1.0
    high_noise_fraction: Share = 0.0

    def conflict(self) -> str:
        """What does not fit together, "" if all does."""
        if self.min_learning_rate <= self.max_learning_rate:
            return ""
        return (
            f"min_learning_rate={self.min_learning_rate}: use at most max_learning_rate ="
            f" {self.max_learning_rate}"
        )

    def conflict_with(self, worlds: int) -> str:
        """The same of a training with so many worlds."""
        samples = worlds * self.horizon
        if samples < 2:
            return f"worlds={worlds}: use at least two, or a longer ppo.horizon"
        if self.minibatches > samples:
            return f"ppo.minibatches={self.minibatches}: use at most worlds * horizon = {samples}"
        return ""


class Ppo(PPO):
    """rsl_rl's PPO with :func:`~lacoloco.pipelines.learn.returns.advantages` and one auxiliary loss
    hook.
    """

    def __init__(
        self,
        sizes: dict[str, int],
        actions: int,
        num_worlds: int,
        config: PpoConfig,
        networks: NetworkConfig,
        device: str = "cpu",
        critic_only: Mapping[str, int] | None = None,
    ) -> None:
        """Build models and buffers for observation groups ``sizes`` (name -> width).

        The critic sees the groups ``critic_only`` besides (asymmetric actor-critic, Pinto et al.
        2017): it is not needed where the policy runs, so it may see what no sensor tells.
        """
        critic_sizes = {**sizes, **(critic_only or {})}
        observations = example({**critic_sizes, EXPLORE: 1}, num_worlds).to(device)
        storage = RolloutStorage("rl", num_worlds, config.horizon, observations, [actions], device)
        super().__init__(
            make_actor(sizes, actions, networks),
            make_critic(critic_sizes, networks),
            storage,
            learning_rate=config.learning_rate,
            gamma=config.gamma,
            lam=config.lam,
            device=device,
            multi_gpu_cfg=parallel.settings(),
        )
        if self.is_multi_gpu:
            self.broadcast_parameters()
        self.config, self.num_worlds = config, num_worlds
        groups = [
            {
                "params": [p for p in self.actor.parameters() if p.requires_grad],
                "lr": config.learning_rate,
            },
            {"params": list(self.critic.parameters()), "lr": config.critic_learning_rate},
        ]
        self.optimizer = torch.optim.Adam(groups, fused=True)
        self._set_learning_rate(config.learning_rate)
        self.exploration = Exploration(
            num_worlds,
            config.greedy_fraction,
            config.noise_hold_steps,
            config.high_noise_fraction,
            device,
        )
        self.desired_kl = config.desired_kl
        self.keeps_normalizer = False
        """True leaves the actor's statistics as they are. A cloned actor is another one with
        others: one of the H1 fell in all episodes instead of 16 % before it had learned at all.
        """
        self.actor_learns = True
        """False leaves the actor as it is, for as long as the critic's advantages would only harm
        it.
        """
        shape = (config.horizon, num_worlds)
        self.delta, self.next_values = (
            torch.zeros(shape, device=device),
            torch.zeros(shape, device=device),
        )
        self.done = torch.zeros(shape, dtype=torch.bool, device=device)

    def act(self, obs: TensorDict) -> torch.Tensor:
        """(N, A) actions for observations (N rows), each sampled as far from the mean as this world
        explores now.
        """
        scale = self.exploration.advance()
        obs[EXPLORE] = scale[:, None]
        with torch.no_grad():
            sampled = super().act(obs)
        mean, std = self.transition.distribution_params
        self.transition.actions = mean + scale[:, None] * (sampled - mean)
        self.transition.actions_log_prob = _gaussian_log_prob(
            self.transition.actions, mean, _scaled(std, scale)
        )
        return self.transition.actions

    def record(
        self,
        reward: torch.Tensor,
        fell: torch.Tensor,
        timed_out: torch.Tensor,
        next_obs: TensorDict,
        delta: torch.Tensor | None = None,
    ) -> None:
        """Store the step begun by :meth:`act`.

        Args:
            reward: (N,) task reward, not yet scaled by the constraints.
            fell: (N,) bool, the future is worth nothing.
            timed_out: (N,) bool, the future is worth V(next_obs).
            next_obs: observations after the step and *before* any reset.
            delta: (N,) termination probabilities of the constraints.
        """
        t = self.storage.step
        self.delta[t] = 0.0 if delta is None else delta
        self.done[t] = fell | timed_out
        self.next_values[t] = 0.0
        ends = select(timed_out)
        if len(ends):
            with torch.no_grad():
                put(self.next_values[t], ends, self.critic(pick(next_obs, ends)).squeeze(-1))
        self.transition.rewards, self.transition.dones = reward, self.done[t]
        self.storage.add_transition(self.transition)
        self.transition.clear()

    def warm_up(self, observations: TensorDict) -> None:
        """Fit the normalisers to observations (n rows) before the first rollout.

        Otherwise the first update learns on raw observations, and the statistics that follow it
        change the policy more than any gradient did.
        """
        self.actor.update_normalization(observations)
        self.critic.update_normalization(observations)

    def compute_returns(self, obs: TensorDict) -> None:
        """Fill returns and advantages; ``obs`` are the observations that the next rollout starts
        from.
        """
        storage = self.storage
        values = storage.values.squeeze(-1)
        with torch.no_grad():
            last = self.critic(obs).squeeze(-1)
        following = torch.cat((values[1:], last[None]))
        next_values = torch.where(self.done, self.next_values, following)
        rewards = terminated(storage.rewards.squeeze(-1), self.delta)
        gain = advantages(
            rewards,
            values,
            next_values,
            self.delta,
            self.done,
            gamma=self.config.gamma,
            lam=self.config.lam,
        )
        storage.returns = (gain + values)[..., None]
        explore = storage.observations[EXPLORE].squeeze(-1) > 0.0
        chosen = gain[explore]
        mean, std = parallel.mean_and_std(chosen)
        storage.advantages = ((gain - mean) / (std + 1e-8))[..., None]

    def auxiliary_losses(
        self, batch: RolloutStorage.Batch, mean: torch.Tensor
    ) -> dict[str, torch.Tensor]:
        """Further losses on the actor by name, given a minibatch and its mean actions (n, A); none
        here.
        """
        return {}

    def update(self) -> dict[str, float]:
        """Several epochs over shuffled minibatches; returns mean metrics.

        Every minibatch draws from all worlds and steps; in the original's code each is one part of
        the worlds.
        """
        config, count = self.config, 0
        totals: dict[str, torch.Tensor] = {}
        for batch in self.storage.mini_batch_generator(config.minibatches, config.epochs):
            loss, metrics = self._loss(batch)
            self.optimizer.zero_grad(set_to_none=True)
            loss.backward()
            if self.is_multi_gpu:
                self.reduce_parameters()
            torch.nn.utils.clip_grad_norm_(self.actor.parameters(), config.max_grad_norm)
            torch.nn.utils.clip_grad_norm_(self.critic.parameters(), config.max_grad_norm)
            self.optimizer.step()
            for name, value in metrics.items():
                totals[name] = totals.get(name, torch.zeros_like(value)) + value.detach()
            count += 1
        # Statistics move only here, so that a rollout and its update see the same network.
        observations = self.storage.observations.flatten(0, 1)
        if not self.keeps_normalizer:
            self.actor.update_normalization(observations)
        self.critic.update_normalization(observations)
        means = {name: float(total) / count for name, total in totals.items()}
        means |= {
            "learning_rate": float(self.learning_rate),
            "explained_variance": self._explained_variance(),
        }
        self.storage.clear()
        return means

    def save(self) -> dict[str, object]:
        """rsl_rl's state and how each world explores."""
        return super().save() | {"exploring": self.exploration.kind}

    def load(self, loaded_dict: dict, load_cfg: dict | None = None, strict: bool = True) -> bool:
        """Restore rsl_rl's ``save``; the learning rate comes back to where it is used."""
        iteration = super().load(loaded_dict, load_cfg, strict)
        self._set_learning_rate(self.learning_rate)
        self.exploration.kind = loaded_dict["exploring"].to(self.device)
        return iteration

    def _loss(self, batch: RolloutStorage.Batch) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        config = self.config
        value = (self.critic(batch.observations) - batch.returns).square().mean()
        if not self.actor_learns:
            return value, {"value": value}
        scale = batch.observations[EXPLORE].squeeze(-1)
        weight = (scale > 0.0).float()
        weight = weight / weight.sum().clamp_min(1.0)
        mean = self.actor(batch.observations)
        std = _scaled(self.actor.distribution.log_std_param.exp().expand_as(mean), scale)
        log_prob = _gaussian_log_prob(batch.actions, mean, std)
        kl = self._adapt_learning_rate(batch, mean.detach(), std.detach(), scale, weight)
        ratio = torch.exp(log_prob - batch.old_actions_log_prob.squeeze(-1))
        gain = batch.advantages.squeeze(-1)
        clipped = ratio.clamp(1.0 - config.clip, 1.0 + config.clip)
        surrogate = -(torch.minimum(ratio * gain, clipped * gain) * weight).sum()
        loss = surrogate + value
        metrics = {"surrogate": surrogate, "value": value}
        if config.bound_weight:
            excess = (mean.abs() - config.bound).clamp_min(0.0).square().sum(dim=-1)
            loss = loss + config.bound_weight * (excess * weight).sum()
        further = self.auxiliary_losses(batch, mean)
        for term in further.values():
            loss = loss + term
        return loss, {**metrics, **further, "kl": kl}

    def _adapt_learning_rate(
        self,
        batch: RolloutStorage.Batch,
        mean: torch.Tensor,
        std: torch.Tensor,
        scale: torch.Tensor,
        weight: torch.Tensor,
    ) -> torch.Tensor:
        old_mean, old_std = batch.old_distribution_params
        old_std = _scaled(old_std, scale)
        terms = (
            (std / old_std).log()
            + (old_std.square() + (old_mean - mean).square()) / (2 * std.square())
            - 0.5
        )
        kl = parallel.average((terms.sum(dim=-1) * weight).sum())
        config, rate = self.config, self.learning_rate
        slower = (rate / 1.5).clamp_min(config.min_learning_rate)
        faster = (rate * 1.5).clamp_max(config.max_learning_rate)
        rate = torch.where(kl < 0.5 * self.desired_kl, faster, rate)
        self._set_learning_rate(torch.where(kl > 2.0 * self.desired_kl, slower, rate))
        return kl

    def _set_learning_rate(self, rate: float | torch.Tensor) -> None:
        """The actor's rate is a 0-d tensor where it is used, so that adapting it never waits for a
        GPU.
        """
        on_gpu = self.optimizer.param_groups[0]["params"][0].is_cuda
        precision = torch.float32 if on_gpu else torch.float64  # what the fused kernels take
        self.learning_rate = torch.as_tensor(rate, dtype=precision, device=self.device)
        self.optimizer.param_groups[0]["lr"] = self.learning_rate

    def _explained_variance(self) -> float:
        returns, values = self.storage.returns, self.storage.values
        return float(1.0 - (returns - values).var() / returns.var().clamp_min(1e-12))


def _scaled(std: torch.Tensor, scale: torch.Tensor) -> torch.Tensor:
    """(n, A) std times the factors (n,); where the mean itself was taken any will do, it has no
    weight.
    """
    return std * torch.where(scale > 0.0, scale, 1.0)[:, None]


def _gaussian_log_prob(
    actions: torch.Tensor, mean: torch.Tensor, std: torch.Tensor
) -> torch.Tensor:
    scaled = (actions - mean) / std
    return (-0.5 * scaled.square() - std.log() - 0.9189385332046727).sum(dim=-1)
