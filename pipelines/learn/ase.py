"""Adversarial Skill Embeddings: PPO whose rewards come from a discriminator and a skill encoder
(paper section III-A).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

import torch
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict

from lacoloco.datasets.config_values import Factor, LearningRate, Share, Widths, Within
from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.learn.discriminator import TransitionNormalizer, imitation_reward
from lacoloco.pipelines.learn.drail import DrailConfig, DrailDiscriminator
from lacoloco.pipelines.learn.encoder import SkillEncoder, cosine, encoder_loss, encoder_reward
from lacoloco.pipelines.learn.gan import GanConfig, GanDiscriminator
from lacoloco.pipelines.learn.latents import project
from lacoloco.pipelines.learn.networks import LATENT, Activation, NetworkConfig
from lacoloco.pipelines.learn.ppo import EXPLORE, Ppo, PpoConfig
from lacoloco.pipelines.learn.replay import ReplayBuffer

POLICY = "policy"
DIVERSITY_SHARE = 0.25
"""Share of a minibatch that the diversity loss looks at: it costs a further pass of the actor."""
REWARDED_AT_ONCE = 2048
"""Transitions that the discriminator looks at together when it pays for them."""
STATISTICS = 2048
"""Transitions of a rollout, and as many demonstrations, that the normaliser takes in."""


Discriminator = Literal["drail", "gan"]
"""Whose reward the policy gets for imitating."""


@dataclass(frozen=True)
class AseConfig:
    """Discriminator, encoder and their rewards.

    Attributes:
        discriminator: ``drail`` or ``gan``.
        gan: Settings of the GAN discriminator.
        drail: Settings of the diffusion discriminator.
        encoder_hidden: Widths of the encoder's hidden layers.
        encoder_activation: Name of their activation function.
        reward_scale: Factor on the whole style reward. It keeps returns near 1 without a value
            normaliser.
        imitation_weight: Weight of the discriminator's reward.
        encoder_weight: Weight of the encoder's reward (the paper's beta).
        labelled_encoder_weight: Weight of the encoder's loss on labelled demonstrations; that on
            the policy's own transitions has weight 1. Without labels it has no effect.
        label_weight: Weight of the KL between the policy and the experts' answers, beside PPO's
            loss. Without experts that were asked it has no effect.
        reward_ceiling: Upper limit of the discriminator's reward.
        diversity: Weight of the diversity loss.
        updates: Gradient steps of discriminator and encoder per iteration.
        batch: Policy transitions per gradient step, half of this rollout and half replayed; as many
            demonstrations are added.
        learning_rate: Learning rate of the discriminator.
        encoder_learning_rate: Learning rate of the encoder.
        replay_capacity: Transitions in the replay buffer. No more than a checkpoint can hold, so
            that a resumed training is the same.
        replay_share: Share of every rollout that goes into the replay buffer. A small share lets
            the buffer span a million samples, so that an unlearned skill is not taken for new.
    """

    discriminator: Discriminator = "drail"
    gan: GanConfig = field(default_factory=GanConfig)
    drail: DrailConfig = field(default_factory=DrailConfig)
    encoder_hidden: Widths = (256, 128)
    encoder_activation: Activation = "elu"
    reward_scale: Factor = 0.1
    imitation_weight: Factor = 1.0
    encoder_weight: Factor = 0.3
    labelled_encoder_weight: Factor = 1.0
    label_weight: Factor = 0.0
    reward_ceiling: Annotated[float, Within(0, 1000, above=True)] = 5.0
    diversity: Factor = 0.01
    updates: Annotated[int, Within(1, 10_000)] = 2
    batch: Annotated[int, Within(2, 2**20)] = 1024
    learning_rate: LearningRate = 3e-4
    encoder_learning_rate: LearningRate = 3e-4
    replay_capacity: Annotated[int, Within(1, 10**8)] = 20_000
    replay_share: Share = 0.02


class Ase(Ppo):
    """Low-level training: pi(a | s, z) against demonstrations, with its own optimisers for
    discriminator and encoder.
    """

    def __init__(
        self,
        sizes: dict[str, int],
        actions: int,
        num_worlds: int,
        demonstrations: Callable[[int], torch.Tensor],
        *,
        ppo: PpoConfig,
        networks: NetworkConfig,
        ase: AseConfig,
        seed: int,
        device: str = "cpu",
        critic_only: Mapping[str, int] | None = None,
    ) -> None:
        """Build everything; ``demonstrations(n)`` returns clean transitions (n, 2F), oldest frame
        first. The critic sees the groups ``critic_only`` besides.
        """
        super().__init__(sizes, actions, num_worlds, ppo, networks, device, critic_only)
        self.ase, self.demonstrations = ase, demonstrations
        dim = demonstrations(1).shape[-1]
        self.normalizer = TransitionNormalizer(dim // 2).to(device)
        self.discriminator = _discriminator(dim, ase).to(device)
        self.encoder = _encoder(dim, sizes[LATENT], ase, self.discriminator).to(device)
        parallel.copy_from_first(self.discriminator, self.encoder)
        self.discriminator_optimizer = _adam(self.discriminator, ase.learning_rate)
        self.encoder_optimizer = _adam(self.encoder, ase.encoder_learning_rate)
        self.replay = ReplayBuffer(ase.replay_capacity, dim, seed=seed + 1, device=device)
        self.labelled: (
            Callable[[int, torch.Generator], tuple[torch.Tensor, torch.Tensor]] | None
        ) = None
        """Demonstrated transitions (n, 2F) with their latents (n, d), once something knows them."""
        self.answers: Callable[[int], tuple[TensorDict, torch.Tensor]] | None = None
        """What the actor sees in n states in which experts were asked, and their actions (n, A),
        NaN where nobody knows.
        """
        self.generator = torch.Generator(device).manual_seed(seed + 2)
        self.transitions = torch.zeros(ppo.horizon, num_worlds, dim, device=device)
        self.valid = torch.ones(ppo.horizon, num_worlds, dtype=torch.bool, device=device)

    def record_transition(
        self, frame: torch.Tensor, next_frame: torch.Tensor, valid: torch.Tensor
    ) -> None:
        """Keep the style transition (N, F), (N, F) of the step about to be recorded; both frames
        before any reset.
        """
        self.transitions[self.storage.step] = torch.cat((frame, next_frame), dim=-1)
        self.valid[self.storage.step] = valid

    def fit_encoder(self, steps: int, batch: int = 2048) -> float:
        """Teach the encoder the labelled demonstrations before there is a rollout; returns its mean
        cosine at the end.
        """
        self.normalizer.update(*(self.demonstrations(4 * batch) for _ in range(2)))
        labelled_loss = torch.zeros(())
        for _ in range(steps):
            labelled_loss = self._labelled_loss(batch)
            _descend(self.encoder_optimizer, labelled_loss)
        return -float(labelled_loss.detach())

    def compute_returns(self, obs: TensorDict) -> None:
        """Add the style rewards of the whole rollout in one batch, then compute returns."""
        rollout = self.transitions.flatten(0, 1)[self._valid_rows()]
        some = rollout[:: max(1, len(rollout) // STATISTICS)]
        self.normalizer.update(some, self.demonstrations(len(some)))
        self.metrics = self._reward_rollout()
        super().compute_returns(obs)

    def update(self) -> dict[str, float]:
        """Discriminator and encoder first, on this rollout; then actor and critic."""
        metrics = self.metrics | self._update_style() | super().update()
        # Without their weights. Diversity is 1 where actions ignore the latent, 0 where they move
        # just as far as it does.
        for name, weight in (("diversity", self.ase.diversity), ("label", self.ase.label_weight)):
            if name in metrics:
                metrics[name] /= weight
        return metrics

    def auxiliary_losses(
        self, batch: RolloutStorage.Batch, mean: torch.Tensor
    ) -> dict[str, torch.Tensor]:
        """Diversity, and what experts say."""
        losses = {}
        if self.ase.diversity:
            losses["diversity"] = self.ase.diversity * self._diversity(batch, mean)
        if self.ase.label_weight and self.answers is not None:
            losses["label"] = self.ase.label_weight * self._distance_to_experts()
        return losses

    def _distance_to_experts(self) -> torch.Tensor:
        """Mean KL of the policy from a Gaussian of its own std around the experts' actions, in
        states where they were asked: sum over actions of (mean - label)^2 / (2 std^2).
        """
        assert self.answers is not None
        observations, actions = self.answers(self.ase.batch)
        error = (self.actor(observations) - actions).nan_to_num()
        std = self.actor.distribution.log_std_param.exp()
        return 0.5 * (error / std).square().sum(dim=-1).mean()

    def _diversity(self, batch: RolloutStorage.Batch, mean: torch.Tensor) -> torch.Tensor:
        """How far the actions move must match how far the latent moves (paper, "Diversity Term").

        The KL of two Gaussians with one fixed std is the squared distance of their means up to a
        factor; as in the original the mean squared distance itself is compared with D_z = 0.5 (1 -
        z . z').
        """
        count = max(1, int(DIVERSITY_SHARE * len(mean)))
        policy, z, explore = (
            batch.observations[name][:count] for name in (POLICY, LATENT, EXPLORE)
        )
        other, weight = project(torch.randn_like(z)), (explore.squeeze(-1) > 0.0).float()
        moved = self.actor(TensorDict({POLICY: policy, LATENT: other}, batch_size=[count]))
        distance = 0.5 - 0.5 * (z * other).sum(dim=-1)
        ratio = (mean[:count] - moved).square().mean(dim=-1) / (distance + 1e-5)
        return ((1.0 - ratio).square() * weight).sum() / weight.sum().clamp_min(1.0)

    def save(self) -> dict[str, object]:
        """rsl_rl's state plus that of the adversarial part."""
        return super().save() | {
            "discriminator": self.discriminator.state_dict(),
            "encoder": self.encoder.state_dict(),
            "normalizer": self.normalizer.state_dict(),
            "discriminator_optimizer": self.discriminator_optimizer.state_dict(),
            "encoder_optimizer": self.encoder_optimizer.state_dict(),
            "replay": self.replay.state_dict(),
            "generator": self.generator.get_state(),
        }

    def load(self, loaded_dict: dict, load_cfg: dict | None = None, strict: bool = True) -> bool:
        """Restore :meth:`save`."""
        self.generator.set_state(loaded_dict["generator"])
        for name in (
            "discriminator",
            "encoder",
            "normalizer",
            "discriminator_optimizer",
            "encoder_optimizer",
            "replay",
        ):
            getattr(self, name).load_state_dict(loaded_dict[name])
        return super().load(loaded_dict, load_cfg, strict)

    @torch.no_grad()
    def _reward_rollout(self) -> dict[str, float]:
        flat = self.normalizer(self.transitions.flatten(0, 1))
        z = self.storage.observations[LATENT].flatten(0, 1)
        # Part by part: a denoiser's activations for a whole rollout leave every cache.
        logits = torch.cat(
            [
                self.discriminator.logits(part, self.generator)
                for part in flat.split(REWARDED_AT_ONCE)
            ]
        )
        imitation = imitation_reward(logits, self.ase.reward_ceiling)
        predicted = self.encoder(flat)
        skill = encoder_reward(predicted, z)
        style = self.ase.imitation_weight * imitation + self.ase.encoder_weight * skill
        # Not times 0: a diverged world's state may be no number.
        style = (self.ase.reward_scale * style).masked_fill(~self.valid.flatten(), 0.0)
        self.storage.rewards += style.view_as(self.storage.rewards)
        rows = self._valid_rows()
        return {
            "imitation_reward": float(imitation[rows].mean()),
            "encoder_reward": float(skill[rows].mean()),
            "encoder_cosine": float(cosine(predicted, z)[rows].mean()),
        }

    def _valid_rows(self) -> torch.Tensor:
        """(n,) rows of the flattened rollout whose transitions did not diverge."""
        return torch.nonzero(self.valid.flatten()).flatten()

    def _update_style(self) -> dict[str, float]:
        """Train discriminator and encoder on this rollout; returns mean metrics."""
        transitions, latents = self._remember_rollout()
        order = torch.randperm(len(transitions), generator=self.generator, device=self.device)
        totals: dict[str, torch.Tensor] = {}
        for index in range(self.ase.updates):
            rows = _minibatch(order, index, self.ase.batch)
            metrics = self._update_discriminator(transitions[rows[: self.ase.batch // 2]])
            metrics |= self._update_encoder(transitions[rows], latents[rows])
            for name, value in metrics.items():
                totals[name] = totals.get(name, 0.0) + value
        return {name: float(total) / self.ase.updates for name, total in totals.items()}

    def _remember_rollout(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Put a share of the rollout's transitions into the replay buffer.

        Returns:
            All its valid transitions (n, 2F), normalised, and their latents (n, d).
        """
        valid = self._valid_rows()
        raw = self.transitions.flatten(0, 1)[valid]
        latents = self.storage.observations[LATENT].flatten(0, 1)[valid]
        few = max(1, int(self.ase.replay_share * len(raw)))
        kept = torch.randperm(len(raw), generator=self.generator, device=self.device)[:few]
        # Raw transitions, because the normaliser's statistics change.
        self.replay.add(raw[kept])
        return self.normalizer(raw), latents

    def _update_discriminator(self, current: torch.Tensor) -> dict[str, torch.Tensor]:
        """One gradient step on current transitions (n, 2F), replayed ones and demonstrations."""
        replayed = self.normalizer(self.replay.sample(self.ase.batch - len(current)))
        demonstrated = self.normalizer(self.demonstrations(self.ase.batch))
        agent = torch.cat((current, replayed))
        loss, metrics = self.discriminator.loss(agent, demonstrated, self.generator)
        accuracy = parallel.average(0.5 * (metrics["agent_accuracy"] + metrics["demo_accuracy"]))
        # A factor, not a branch: nothing waits for the device, and all processes take the same
        # steps.
        learns = accuracy <= self.discriminator.config.max_accuracy
        _descend(self.discriminator_optimizer, loss * learns)
        return {**metrics, "discriminator": loss.detach()}

    def _update_encoder(
        self, transitions: torch.Tensor, latents: torch.Tensor
    ) -> dict[str, torch.Tensor]:
        """One gradient step on transitions (n, 2F) with their latents (n, d), and on labelled
        demonstrations.
        """
        loss = encoder_loss(self.encoder(transitions), latents)
        total, weight = loss, self.ase.labelled_encoder_weight
        if weight > 0.0 and self.labelled is not None:
            total = loss + weight * self._labelled_loss(self.ase.batch // 2)
        _descend(self.encoder_optimizer, total)
        return {"encoder": loss.detach()}

    def _labelled_loss(self, count: int) -> torch.Tensor:
        assert self.labelled is not None
        transitions, z = self.labelled(count, self.generator)
        return encoder_loss(self.encoder(self.normalizer(transitions)), z)


def _discriminator(dim: int, ase: AseConfig) -> GanDiscriminator | DrailDiscriminator:
    kind = {"gan": GanDiscriminator, "drail": DrailDiscriminator}[ase.discriminator]
    return kind(dim, getattr(ase, ase.discriminator))


def _encoder(
    dim: int, latent_dim: int, ase: AseConfig, discriminator: GanDiscriminator | DrailDiscriminator
) -> SkillEncoder:
    trunk = None
    if isinstance(discriminator, GanDiscriminator) and ase.gan.encoder_shares:
        trunk = discriminator.mlp
    return SkillEncoder(dim, latent_dim, ase.encoder_hidden, ase.encoder_activation, trunk)


def _minibatch(order: torch.Tensor, index: int, size: int) -> torch.Tensor:
    """(size,) rows of minibatch ``index``, from the start of ``order`` again where it ends."""
    places = torch.arange(index * size, (index + 1) * size, device=order.device)
    return order[places % len(order)]


def _adam(module: torch.nn.Module, rate: float) -> torch.optim.Adam:
    return torch.optim.Adam(module.parameters(), lr=rate, fused=True)


def _descend(optimizer: torch.optim.Adam, loss: torch.Tensor) -> None:
    optimizer.zero_grad(set_to_none=True)
    loss.backward()
    parallel.average_gradients(optimizer.param_groups[0]["params"])
    optimizer.step()
