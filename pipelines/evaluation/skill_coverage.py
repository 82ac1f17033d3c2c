"""Deterministic skill coverage: what fixed latents do from a standing start, without exploration
noise.

Statistics of a training deceive: sampled actions walk where the mean action stands still, and
resets into clips keep a policy in whatever it was put into. So the skills are counted the way a
high level will use them, motors as strong as they are, and the clips are counted by the same rules
beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import torch

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.evaluation.skill_cells import CellCoverage, SkillCells
from lacoloco.pipelines.learn.latents import sample_latents
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.kinematics import EndEffectorChain
from lacoloco.pipelines.sim.observation import FULL, Observation
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.randomisation import NO_RANDOMISATION
from lacoloco.pipelines.sim.state import RobotState, style_frame
from lacoloco.pipelines.sim.tasks import ResetConfig, imitate_task
from lacoloco.pipelines.stage import SILENT, Progress, track_steps
from lacoloco.robots.numbers import SkillThresholds
from lacoloco.robots.spec import RobotSpec

REACH_SECONDS = 1.0
QUANTILES = {"p10": 0.1, "p50": 0.5, "p90": 0.9}
PLANAR, YAW_RATE = slice(4, 6), slice(9, 10)
"""Columns of a style frame."""
CLIP_WINDOWS = 512
"""Moments of the clips that are looked at, drawn by duration."""


@dataclass(frozen=True)
class Behaviour:
    """What N robots did in a window.

    Attributes:
        speed: (N,) mean planar speed of the base [m/s].
        lift: (N,) mean height of the end effector above its height in standing, over the last
            second [m].
        frame: (N, 10 + 2J) mean style frame.
        fell: (N,) bool.
        thresholds: what counts as walking and as reaching.
    """

    speed: torch.Tensor
    lift: torch.Tensor
    frame: torch.Tensor
    fell: torch.Tensor
    thresholds: SkillThresholds

    @property
    def motion(self) -> torch.Tensor:
        """(N, 4) mean forward and lateral velocity [m/s], yaw rate [rad/s], and lift [m]."""
        return torch.cat((self.frame[:, PLANAR], self.frame[:, YAW_RATE], self.lift[:, None]), 1)

    def shares(self) -> dict[str, float]:
        """Shares that fall, reach, walk (and do not reach) and stand (none of these); they add up
        to 1.
        """
        reach = (self.lift > self.thresholds.reach_height) & ~self.fell
        walk = (self.speed > self.thresholds.walk_speed) & ~self.fell & ~reach
        kinds = {
            "walk": walk,
            "reach": reach,
            "fall": self.fell,
            "stand": ~(walk | reach | self.fell),
        }
        return {name: float(mask.float().mean()) for name, mask in kinds.items()}

    def distribution(self) -> dict[str, float]:
        """Mean and quantiles of speed and lift over those that did not fall; 0 where all did."""
        metrics = {}
        for name, values in (("speed", self.speed), ("lift", self.lift)):
            values = torch.zeros(1) if self.fell.all() else values[~self.fell]
            metrics[name] = float(values.mean())
            metrics |= {
                f"{name}_{label}": float(values.quantile(share))
                for label, share in QUANTILES.items()
            }
        return metrics


class SkillCoverage:
    """Counts skills again and again in one environment, from the same states and with the same
    latents each time.

    It draws from generators of its own: a training that is measured stays bit for bit what it would
    have been.
    """

    def __init__(
        self,
        spec: RobotSpec,
        library: MotionLibrary,
        *,
        latents: int = 256,
        seconds: float = 3.0,
        seed: int = 0,
        observation: Observation = FULL,
    ) -> None:
        """Let ``latents`` robots stand and look at the clips once; a latent will be held for
        ``seconds``, and policies see what ``observation`` says.
        """
        self.seed, self.steps = seed, round(seconds / CONTROL_DT)
        self.env = standing_env(spec, latents, seed, library.device, observation)
        self._start = deepcopy(self.env.state_dict())
        standing_height = float(self.env.end_effector()[:, 2].mean())
        self._standing_frame = self.env.frame().mean(dim=0)
        self._clip_frames = clip_means(library)
        window = (self.steps - self.steps // 2) * CONTROL_DT
        clips = clip_behaviour(spec, library, window, standing_height, seed)
        self._spread = clips.frame.std(dim=0).clamp_min(1e-3)
        self._cells, self._clip_motion = SkillCells.of(spec), clips.motion
        self.clips = {
            f"clips_{name}": value
            for name, value in (clips.shares() | clips.distribution()).items()
        }
        """The clips' own shares, means and quantiles, named like the latents' with ``clips_`` for
        ``coverage_``.
        """

    def measure(self, policy: Policy) -> dict[str, float]:
        """Hold uniform latents with mean actions and classify what they do.

        Returns:
            Shares ``coverage_walk``, ``coverage_reach``, ``coverage_fall``, ``coverage_stand``;
            means and quantiles of ``coverage_speed`` [m/s] and ``coverage_lift`` [m];
            ``coverage_clips``, the share of clips that some latent reproduces; ``coverage_spread``,
            how much the latents differ from each other (1: as much as moments of the clips do);
            those of :meth:`~lacoloco.pipelines.evaluation.skill_cells.CellCoverage.metrics`; and
            the clips' own metrics.
        """
        done = self._hold(policy)
        metrics = done.shares() | done.distribution()
        upright = done.frame[~done.fell] / self._spread
        metrics["clips"] = self._reproduced(upright)
        metrics["spread"] = float(upright.var(dim=0).mean().sqrt()) if len(upright) > 1 else 0.0
        cells = self._cells_of(done).metrics()
        return {f"coverage_{name}": value for name, value in metrics.items()} | self.clips | cells

    def cells(self, policy: Policy, progress: Progress = SILENT) -> CellCoverage:
        """The cells that the policy's latents reach, beside those of the clips."""
        return self._cells_of(self._hold(policy, progress))

    def _cells_of(self, done: Behaviour) -> CellCoverage:
        upright = done.motion[~done.fell]
        return CellCoverage(self._cells, self._clip_motion, upright, len(done.fell))

    def _hold(self, policy: Policy, progress: Progress = SILENT) -> Behaviour:
        env = self.env
        env.load_state_dict(deepcopy(self._start))  # its counters are counted up in place
        generator = torch.Generator().manual_seed(self.seed)
        z = sample_latents(env.num_worlds, policy.head.sizes["latent"], generator).to(env.device)
        return hold(env, policy, z, self.steps, progress)

    def _reproduced(self, reached: torch.Tensor) -> float:
        """Share of clips to which some latent has come at least half of the way from standing, by
        mean style frame.
        """
        if not len(reached):
            return 0.0
        clips, standing = self._clip_frames / self._spread, self._standing_frame / self._spread
        nearest = torch.cdist(clips, reached).amin(dim=1)
        return float((nearest < 0.5 * torch.cdist(clips, standing[None])[:, 0]).float().mean())


def hold(
    env: LeggedEnv,
    policy: Policy,
    latents: torch.Tensor,
    steps: int,
    progress: Progress = SILENT,
) -> Behaviour:
    """Hold a latent in every world and watch the second half.

    Args:
        env: Robots that stand; see :func:`standing_env`.
        policy: A low level.
        latents: (N, d) unit latents.
        steps: How long [control steps].
        progress: Told after every step.
    """
    standing_height = float(env.end_effector()[:, 2].mean())
    fell = torch.zeros(env.num_worlds, dtype=torch.bool, device=env.device)
    speeds, heights, frames = [], [], []
    for step in track_steps(progress, f"holding {len(latents)} latents", steps):
        fell = fell | env.step(policy(env.observe(), latents)).fell
        if step >= steps // 2:
            speeds.append(env.state.lin_vel_b[:, :2].norm(dim=-1))
            heights.append(env.end_effector()[:, 2])
            frames.append(env.frame())
    return _behaviour(speeds, heights, frames, fell, standing_height, env.spec.skills)


def clip_behaviour(
    spec: RobotSpec, library: MotionLibrary, seconds: float, standing_height: float, seed: int
) -> Behaviour:
    """What the clips show in windows of ``seconds`` (or as long as the longest clip), drawn by
    duration.
    """
    seconds = min(seconds, float(library.durations.max()))
    generator = torch.Generator(library.device).manual_seed(seed)
    clips, begin = library.sample(CLIP_WINDOWS, generator=generator, margin=seconds)
    end_effector = EndEffectorChain(spec, library.device)
    speeds, heights, frames = [], [], []
    for step in range(max(1, round(seconds / CONTROL_DT))):
        state = RobotState.from_motion(library.frames(clips, begin + step * CONTROL_DT))
        speeds.append(state.lin_vel_b[:, :2].norm(dim=-1))
        qpos = torch.cat((state.root_pos, state.root_quat, state.joint_pos), dim=-1)
        heights.append(end_effector(qpos)[:, 2])
        frames.append(style_frame(state))
    fell = torch.zeros_like(clips, dtype=torch.bool)
    return _behaviour(speeds, heights, frames, fell, standing_height, spec.skills)


def clip_means(library: MotionLibrary, samples: int = 64) -> torch.Tensor:
    """(clips, 10 + 2J) mean style frame of every clip, from ``samples`` equally spaced moments
    each.
    """
    clips = torch.arange(len(library), device=library.device).repeat_interleave(samples)
    share = torch.linspace(0.0, 1.0, samples, device=library.device).repeat(len(library))
    frames = library.frames(clips, share * library.durations[clips])
    return style_frame(RobotState.from_motion(frames)).view(len(library), samples, -1).mean(dim=1)


def standing_height_of(spec: RobotSpec, device: torch.device) -> float:
    """Height of the end effector of a robot that stands in its default pose [m]."""
    qpos = torch.tensor(spec.default_qpos(), dtype=torch.float32, device=device)
    return float(EndEffectorChain(spec, device)(qpos[None])[0, 2])


def _behaviour(
    speeds: Sequence[torch.Tensor],
    heights: Sequence[torch.Tensor],
    frames: Sequence[torch.Tensor],
    fell: torch.Tensor,
    standing_height: float,
    thresholds: SkillThresholds,
) -> Behaviour:
    last = torch.stack(tuple(heights[-round(REACH_SECONDS / CONTROL_DT) :])) - standing_height
    return Behaviour(
        torch.stack(tuple(speeds)).mean(0),
        last.mean(0),
        torch.stack(tuple(frames)).mean(0),
        fell,
        thresholds,
    )


def standing_env(
    spec: RobotSpec, worlds: int, seed: int, device: torch.device, observation: Observation
) -> LeggedEnv:
    """Robots that stand in their default pose, without noise, pushes and randomisation, motors as
    strong as they are.
    """
    still = ResetConfig(clip_share=0.0, lin_vel=0.0, ang_vel=0.0, joint_scale=(1.0, 1.0))
    task = replace(
        imitate_task(spec, constrained=False),
        noise=0.0,
        training_limits=False,
        reset=still,
        randomisation=NO_RANDOMISATION,
    )
    return LeggedEnv(spec, task, worlds, seed=seed, device=str(device), observation=observation)
