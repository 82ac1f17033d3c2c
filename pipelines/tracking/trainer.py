"""A policy that follows clips in simulation: what was retargeted becomes something that a robot has
done.

A retargeted clip is kinematics. Its feet stand exactly on a floor into which any simulated foot
sinks, its trunk is carried by forces that nobody has checked against the motors: a discriminator
needs no more to tell the robot from it for ever, and actions inferred from it hold for a tenth of a
second. Followed by a policy that sees what comes next (as DeepMimic does, but in the base frame:
where on the floor and with which heading does not matter), the same motion obeys the same physics
as the robot that is to learn it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import torch
from tensordict import TensorDict

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.learn.cat import SoftTerminations, ramp
from lacoloco.pipelines.learn.metric_accumulator import Tally
from lacoloco.pipelines.learn.networks import NetworkConfig, geometric, set_std
from lacoloco.pipelines.learn.ppo import Ppo, PpoConfig
from lacoloco.pipelines.masking import perhaps_any, pick, select
from lacoloco.pipelines.policies import Head, Policy
from lacoloco.pipelines.sim.env import LeggedEnv, Step
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.state import layout, width
from lacoloco.pipelines.sim.tasks import Task, imitate_task
from lacoloco.pipelines.tracking.reference_motion import References
from lacoloco.robots.spec import RobotSpec

POLICY, REFERENCE = "policy", "reference"
NEVER = -1
"""Age of an episode at which nobody ever is."""


@dataclass(frozen=True)
class TrackerConfig:
    """Training of the tracker.

    Attributes:
        worlds: parallel worlds.
        samples: control steps in all.
        episode_s: seconds until a world begins at another moment.
        standing: share of the episodes that begin standing still in the default pose, at a moment
            slower than the robot's ``slow_speed``: clips rarely show how one begins.
        stopping: share of the other episodes in which the robot is to stand still from some moment
            on: clips rarely show how one stops, and never where a target is.
        stop_after_s: between which two ages of the episode that moment is.
        grace_s: seconds after such a beginning or moment in which it may be as far from the clip as
            it likes.
        ramp: shares of the training between which the limit on the foot forces rises to full
            strength.
        std: exploration std at the start and at the end, in raw action units, around the inferred
            actions.
    """

    worlds: int = 512
    samples: int = 3_000_000
    episode_s: float = 4.0
    standing: float = 0.2
    stopping: float = 0.2
    stop_after_s: tuple[float, float] = (0.3, 2.5)
    grace_s: float = 0.6
    ramp: tuple[float, float] = (0.4, 0.8)
    std: tuple[float, float] = (0.12, 0.05)
    ppo: PpoConfig = field(
        default_factory=lambda: PpoConfig(
            horizon=24,
            gamma=0.97,
            learning_rate=2e-4,
            min_learning_rate=2e-5,
            max_learning_rate=3e-3,
            desired_kl=0.02,
        )
    )
    networks: NetworkConfig = field(default_factory=NetworkConfig)


class Shadow:
    """N worlds, each on its way through a clip; ``rows`` (N,) are the moments that they should be
    in.

    ``stop_at`` (N,) is the age of the episode, in control steps, at which it is left for standing
    still, ``NEVER`` in most.
    """

    def __init__(
        self,
        spec: RobotSpec,
        library: MotionLibrary,
        references: References,
        config: TrackerConfig,
        worlds: int,
        *,
        seed: int,
        device: str,
    ) -> None:
        """Build the worlds; ``references`` are those of ``library``."""
        self.config, self.motions, self.references = config, library, references
        self.env = LeggedEnv(spec, _task(spec, config), worlds, seed=seed, device=device)
        self.draw = torch.Generator(device).manual_seed(seed + 1)
        self.states = references.states
        self.rows = torch.zeros(worlds, dtype=torch.long, device=device)
        self.grace = torch.zeros_like(self.rows)
        self.stop_at = torch.full_like(self.rows, NEVER)
        slow = references.speed < spec.tracking.slow_speed
        self._slow = torch.nonzero(slow if bool(slow.any()) else ~slow).flatten()

    def observe(self) -> TensorDict:
        """The robot's own view, and what comes next."""
        groups = {POLICY: self.env.observe(), REFERENCE: self.references.ahead(self.rows)}
        return TensorDict(groups, batch_size=[self.env.num_worlds])

    def step(self, residual: torch.Tensor) -> tuple[Step, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Add ``residual`` (N, J) to the inferred actions and go one step on.

        Returns:
            The step, (N,) reward in [0, 1], (N,) bool lost or fallen, (N,) bool ended otherwise.
        """
        step = self.env.step(self.references.actions[self.rows] + residual)
        self.rows = torch.minimum(self.rows + 1, self.states.last[self.rows])
        reward, lost = self.references.compare(self.env.state, self.rows)
        lost = step.fell | lost & (self.env.steps > self.grace)
        ended = (step.timed_out | (self.rows == self.states.last[self.rows])) & ~lost
        stops = self.env.steps == self.stop_at
        self.rows = torch.where(stops, self.references.rest, self.rows)
        self.grace = torch.where(
            stops, self.env.steps + round(self.config.grace_s / CONTROL_DT), self.grace
        )
        return step, reward.masked_fill(~step.valid, 0.0), lost, ended

    def begin(self, mask: torch.Tensor) -> None:
        """Begin anew in the worlds of ``mask`` (N,) bool: at any moment in its state, or standing
        at a slow one.
        """
        count = self.env.num_worlds
        anywhere = self.states.rows(
            *self.motions.sample(count, generator=self.draw, margin=2.0 * CONTROL_DT)
        )
        pause = self._slow[
            torch.randint(len(self._slow), (count,), generator=self.draw, device=self.draw.device)
        ]
        kind, when = torch.rand(2, count, generator=self.draw, device=self.draw.device)
        standing = kind < self.config.standing
        self.put(mask, torch.where(standing, pause, anywhere), standing)
        earliest, latest = (seconds / CONTROL_DT for seconds in self.config.stop_after_s)
        stops = mask & (kind > 1.0 - self.config.stopping * (1.0 - self.config.standing))
        self.stop_at = torch.where(
            stops, (earliest + when * (latest - earliest)).long(), self.stop_at
        )

    def put(self, mask: torch.Tensor, rows: torch.Tensor, standing: torch.Tensor) -> None:
        """Put the worlds of ``mask`` at the moments ``rows`` (N,), those of ``standing`` (N,) bool
        in the default pose.

        None of them is to stop.
        """
        self.rows = torch.where(mask, rows, self.rows)
        grace = torch.where(standing, round(self.config.grace_s / CONTROL_DT), 0)
        self.grace = torch.where(mask, grace, self.grace)
        self.stop_at = torch.where(mask, NEVER, self.stop_at)
        self.env.reset(mask)
        inside = select(mask & ~standing)
        if len(inside):
            chosen = pick(self.rows, inside)
            self.env.start_from(
                inside,
                self.states.qpos[chosen],
                self.states.qvel[chosen],
                self.references.before[chosen],
            )


class TrackerTrainer:
    """PPO on following the clips; see :class:`lacoloco.pipelines.training.loop.Trainer`."""

    def __init__(
        self,
        spec: RobotSpec,
        library: MotionLibrary,
        config: TrackerConfig,
        *,
        seed: int,
        device: str,
    ) -> None:
        """Build worlds and learner."""
        torch.manual_seed(seed)
        self.config = config
        references = References(spec, library)
        self.shadow = Shadow(
            spec, library, references, config, config.worlds, seed=seed, device=device
        )
        env = self.shadow.env
        sizes = {POLICY: width(env.terms), REFERENCE: self.shadow.references.width}
        self.algorithm = Ppo(
            sizes, env.num_actions, config.worlds, config.ppo, config.networks, device
        )
        self.terminations = SoftTerminations({c.name: c.max_p for c in env.task.constraints})
        self.head = Head(
            "track", sizes, env.num_actions, config.networks, layout(env.terms), "imitate"
        )
        self.samples_per_iteration = config.worlds * config.ppo.horizon
        everyone = torch.ones(config.worlds, dtype=torch.bool, device=device)
        self.shadow.begin(everyone)
        self.algorithm.warm_up(self._first_observations(everyone))

    @property
    def iterations(self) -> int:
        """Iterations that the budget of samples allows."""
        return max(1, round(self.config.samples / self.samples_per_iteration))

    def iterate(self, progress: float) -> dict[str, float]:
        """One rollout and its update."""
        shadow, algorithm, config = self.shadow, self.algorithm, self.config
        set_std(algorithm.actor, geometric(config.std, progress))
        strength, tally = ramp(progress, *config.ramp), Tally()
        obs = shadow.observe()
        for _ in range(config.ppo.horizon):
            step, reward, lost, ended = shadow.step(algorithm.act(obs))
            delta = self.terminations(step.violations, strength) if step.violations else None
            next_obs, over = shadow.observe(), lost | ended
            algorithm.record((1.0 - config.ppo.gamma) * reward, lost, ended, next_obs, delta)
            if perhaps_any(over):
                shadow.begin(over)
                next_obs = shadow.observe()
            obs = next_obs
            tally.add(reward=reward.mean(), lost=lost.sum(), falls=step.fell.sum())
        algorithm.compute_returns(obs)
        figures, sums = algorithm.update(), tally.read()
        per_thousand = 1000.0 / self.samples_per_iteration
        return figures | {
            "reward": sums["reward"] / config.ppo.horizon,
            "lost_per_1000_steps": per_thousand * sums["lost"],
            "falls_per_1000_steps": per_thousand * sums["falls"],
            **{
                f"violation_{name}": float(share)
                for name, share in self.terminations.violated.items()
            },
            "std": geometric(config.std, progress),
        }

    def policy(self) -> Policy:
        """The trained actor, deterministic."""
        return Policy(self.head, self.algorithm.actor.eval())

    def state_dict(self) -> dict[str, Any]:
        """See :class:`lacoloco.pipelines.training.loop.Trainer`."""
        shadow = self.shadow
        return {
            "algorithm": self.algorithm.save(),
            "env": shadow.env.state_dict(),
            "terminations": self.terminations.state_dict(),
            "draw": shadow.draw.get_state(),
            "rows": shadow.rows,
            "grace": shadow.grace,
            "stop_at": shadow.stop_at,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See :class:`lacoloco.pipelines.training.loop.Trainer`."""
        self.algorithm.load(state["algorithm"], None, True)
        self.shadow.env.load_state_dict(state["env"])
        self.terminations.load_state_dict(state["terminations"])
        self.shadow.draw.set_state(state["draw"])
        for name in ("rows", "grace", "stop_at"):
            setattr(self.shadow, name, state[name].to(self.shadow.env.device))

    def _first_observations(self, everyone: torch.Tensor) -> TensorDict:
        seen = []
        for _ in range(8):
            self.shadow.begin(everyone)
            for _ in range(4):
                noise = self.config.std[0] * torch.randn(len(everyone), self.shadow.env.num_actions)
                self.shadow.step(noise.to(everyone.device))
                seen.append(self.shadow.observe())
        self.shadow.begin(everyone)
        return torch.cat(seen)


def _task(spec: RobotSpec, config: TrackerConfig) -> Task:
    """Clips must show every world the low level will meet, as those of the experts do, but nothing
    that was not meant.
    """
    task = imitate_task(spec, constrained=True)
    return replace(
        task,
        noise=0.0,
        episode_s=config.episode_s,
        reset=replace(task.reset, clip_share=0.0, lin_vel=0.0, ang_vel=0.0),
        randomisation=replace(task.randomisation, push=0.0),
    )
