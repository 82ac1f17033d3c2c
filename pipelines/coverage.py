"""Deterministic skill coverage: what fixed latents do from a standing start, without exploration noise.

Statistics of a training deceive: sampled actions walk where the mean action stands still, and resets into clips keep a
policy in whatever it was put into. So the skills are counted the way a high level will use them.
"""

from __future__ import annotations

from dataclasses import replace

import torch

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.learn.latents import sample_latents
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.state import RobotState, style_frame
from lacoloco.pipelines.sim.tasks import NO_RANDOMISATION, ResetConfig, imitate_task
from lacoloco.robots.spec import RobotSpec

WALK_SPEED = 0.15
"""Mean planar speed [m/s] over the second half of the hold from which a latent counts as walking."""
REACH_HEIGHT = 0.15
"""Height [m] of the end effector above its standing height, held on average over the last second, that counts as reaching."""


def skill_coverage(
    spec: RobotSpec, policy: Policy, library: MotionLibrary, *, latents: int = 256, seconds: float = 3.0, seed: int = 0
) -> dict[str, float]:
    """Hold ``latents`` uniform latents for ``seconds`` each from a standing start with mean actions, and classify.

    Returns:
        Shares ``coverage_walk``, ``coverage_reach``, ``coverage_fall``, ``coverage_stand`` (none of these), means of
        speed [m/s] and end-effector lift [m], and ``coverage_clips``: the share of clips whose mean style frame is
        closer to some latent's than to the standing pose, in units of the clips' spread.
    """
    env = _standing_env(spec, latents, seed, library.device)
    z = sample_latents(latents, policy.head.sizes["latent"], torch.Generator().manual_seed(seed)).to(env.device)
    steps = round(seconds / CONTROL_DT)
    fell = torch.zeros(latents, dtype=torch.bool, device=env.device)
    standing_height = env.end_effector()[:, 2].mean()
    standing_frame = env.frame().mean(dim=0)
    speed, lift, frames, counted = 0.0, 0.0, 0.0, 0
    for step in range(steps):
        fell |= env.step(policy(env.observe(), z)).fell
        if step >= steps // 2:
            speed = speed + env.state.lin_vel_b[:, :2].norm(dim=-1)
            frames, counted = frames + env.frame(), counted + 1
        if step >= steps - 50:
            lift = lift + (env.end_effector()[:, 2] - standing_height) / min(50, steps)
    speed, frames = speed / counted, frames / counted
    reach = (lift > REACH_HEIGHT) & ~fell
    walk = (speed > WALK_SPEED) & ~fell & ~reach
    shares = {"walk": walk, "reach": reach, "fall": fell, "stand": ~(walk | reach | fell)}
    figures = {f"coverage_{name}": float(mask.float().mean()) for name, mask in shares.items()}
    return figures | {
        "coverage_speed": float(speed.mean()),
        "coverage_lift": float(lift.mean()),
        "coverage_clips": _reproduced(library, frames[~fell], standing_frame),
    }


def _standing_env(spec: RobotSpec, worlds: int, seed: int, device: torch.device) -> LeggedEnv:
    still = ResetConfig(clip_share=0.0, lin_vel=0.0, ang_vel=0.0, joint_scale=(1.0, 1.0))
    task = replace(imitate_task(spec, constrained=False), noise=0.0, reset=still, randomisation=NO_RANDOMISATION)
    return LeggedEnv(spec, task, worlds, seed=seed, device=str(device))


def _reproduced(library: MotionLibrary, reached: torch.Tensor, standing: torch.Tensor) -> float:
    """Share of clips that some latent reproduces better than standing does, by mean style frame."""
    if not len(reached):
        return 0.0
    means = clip_means(library)
    spread = means.std(dim=0).clamp_min(1e-3) if len(means) > 1 else torch.ones_like(standing)
    nearest = torch.cdist(means / spread, reached / spread).amin(dim=1)
    return float((nearest < torch.cdist(means / spread, (standing / spread)[None])[:, 0]).float().mean())


def clip_means(library: MotionLibrary, samples: int = 64) -> torch.Tensor:
    """(clips, 10 + 2J) mean style frame of every clip, from ``samples`` equally spaced moments each."""
    clips = torch.arange(len(library), device=library.device).repeat_interleave(samples)
    share = torch.linspace(0.0, 1.0, samples, device=library.device).repeat(len(library))
    frames = library.frames(clips, share * library.durations[clips])
    return style_frame(RobotState.from_motion(frames)).view(len(library), samples, -1).mean(dim=1)
