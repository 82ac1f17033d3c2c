"""Stage generate: experts perform the synthetic motions, 120 x 10 s of walking and 20 x 10 s of
reaching, recorded clean.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
import torch

from lacoloco.datasets import published
from lacoloco.datasets.artifact import read_header
from lacoloco.datasets.clip import Clip, save_clips
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.generation.expert_trainer import (
    ExpertConfig,
    ExpertTrainer,
    clean,
    reach_expert,
    smoke_expert,
    wide,
)
from lacoloco.pipelines.policies import Policy, load_policies, save_policies
from lacoloco.pipelines.robot import belongs_to, record_of
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.pipelines.training.checkpoint import remove_checkpoints
from lacoloco.pipelines.training.loop import train
from lacoloco.robots.registry import load_robot
from lacoloco.robots.spec import RobotSpec

SKILLS = {"walk": "walk", "reach_in_place": "reach"}
"""Expert task -> skill name of its clips."""
SHOWN = ("reward", "velocity_error", "target_error", "falls_per_1000_steps", "std")
LICENCE = "BSD-3-Clause (made by lacoloco)"


@dataclass(frozen=True)
class GenerateConfig:
    """Experts and recording.

    Attributes:
        walk_clips: number of walking clips (paper: 120).
        reach_clips: number of reaching clips (paper: 20).
        reach_weight: how often a moment of reaching is sampled for one of walking. By duration
            alone one latent in seven would be left for reaching, at 4 it is two in five, at 9 three
            in five; a low level ends up showing it a third as often as its clips do.
        seconds: length of a clip.
        settle: seconds from the start of a clip that do not count in the tracking errors.
    """

    walk: ExpertConfig = field(default_factory=lambda: ExpertConfig(samples=3_000_000))
    reach: ExpertConfig = field(default_factory=reach_expert)
    walk_clips: int = 120
    reach_clips: int = 20
    reach_weight: float = 9.0
    seconds: float = 10.0
    settle: float = 1.0


def laptop() -> GenerateConfig:
    """The paper's clips from experts trained in a few minutes each on two cores."""
    return GenerateConfig()


def smoke() -> GenerateConfig:
    """Seconds; the experts have learned nothing, so only that everything runs is shown."""
    return GenerateConfig(
        smoke_expert(), smoke_expert(), walk_clips=3, reach_clips=2, seconds=0.2, settle=0.02
    )


def gpu() -> GenerateConfig:
    """The paper's clips from experts with thirteen times the laptop's samples each."""
    return GenerateConfig(wide(ExpertConfig(), 330), wide(reach_expert(), 330))


def paper() -> GenerateConfig:
    """The paper's clips from experts with the budgets of its Solo12 experts: 2000 and 7000
    iterations (facts 3).
    """
    return GenerateConfig(wide(ExpertConfig(), 2000), wide(reach_expert(), 7000))


PRESETS: dict[str, Callable[[], GenerateConfig]] = {
    "smoke": smoke,
    "laptop": laptop,
    "gpu": gpu,
    "paper": paper,
}


def run(
    config: GenerateConfig, context: StageContext, *, robot: str = "solo12", retrain: bool = False
) -> StageResult:
    """Record clips of both experts; train the experts first when the run has none for this robot,
    or if asked to.

    Raises:
        RobotError: unknown robot.
        StageError: an expert falls too often to record enough clean clips.
    """
    spec = load_robot(robot)
    experts = _experts(config, context, spec, retrain)
    _, policies = load_policies(experts, *SKILLS, device=context.device)
    clips: list[Clip] = []
    metrics: dict[str, float] = {}
    directory = context.store.begin(context.run, "generate")
    for task, count in (("walk", config.walk_clips), ("reach_in_place", config.reach_clips)):
        recorded, figures = record(spec, task, policies[task], count, config, context)
        clips += recorded
        metrics |= figures
    save_clips(
        directory.file("artifact.h5"),
        clips,
        robot=record_of(spec),
        config=asdict(config),
        seed=context.seed,
        parents=[experts],
        command=context.command,
        metadata={"metrics": metrics},
    )
    seconds = sum(clip.duration for clip in clips)
    return StageResult(directory.complete(), {"clips": len(clips), "seconds": seconds, **metrics})


def _experts(config: GenerateConfig, context: StageContext, spec: RobotSpec, retrain: bool) -> Path:
    """The run's newest experts of this robot, else the published ones, else newly trained ones."""
    if not retrain and not context.resume:
        for path in reversed(context.store.all(context.run, "experts")):
            if belongs_to(read_header(path), spec):
                return path
        bundled = published.find(f"{spec.name}-experts")
        if bundled is not None and belongs_to(read_header(bundled), spec):
            context.progress.say(
                f"using the published experts of {spec.name}; --retrain makes them again"
            )
            return bundled
        context.progress.say(
            f"run '{context.run}' has no experts for {spec.name} yet: training them"
        )
    return train_experts(config, context, spec)


def train_experts(config: GenerateConfig, context: StageContext, spec: RobotSpec) -> Path:
    """Train the walking and the reaching expert and write both into one artifact of the stage
    ``experts``.
    """
    directory = context.store.begin(context.run, "experts", resume=context.resume)
    policies, metrics = [], {}
    for task, expert in (("walk", config.walk), ("reach_in_place", config.reach)):
        trainer = ExpertTrainer(spec, task, expert, seed=context.seed, device=context.device)
        figures = train(
            trainer, trainer.iterations, directory.path, context, f"expert {task}", SHOWN
        )
        policies.append(trainer.policy())
        metrics |= {f"{task}_seconds": figures["seconds"], f"{task}_samples": figures["samples"]}
    save_policies(
        directory.file("artifact.h5"),
        policies,
        spec=spec,
        context=context,
        config=asdict(config),
        parents=[],
        metrics=metrics,
    )
    remove_checkpoints(directory.path)
    return directory.complete()


def record(
    spec: RobotSpec,
    task_name: str,
    policy: Policy,
    count: int,
    config: GenerateConfig,
    context: StageContext,
) -> tuple[list[Clip], dict[str, float]]:
    """Record ``count`` clips of one expert, deterministic, without noise or pushes, each in its own
    world.

    Every clip begins with the robot standing still: nothing else shows how one begins to walk or to
    lift a foot. More worlds than clips are run, and only those that never fell are kept, so no clip
    contains a reset.

    Raises:
        StageError: fewer than ``count`` worlds stayed up.
    """
    steps, settle = round(config.seconds / CONTROL_DT), round(config.settle / CONTROL_DT)
    base = clean(load_task(spec, task_name))
    standing = replace(base.reset, joint_scale=(0.9, 1.1), lin_vel=0.0, ang_vel=0.0)
    task = replace(base, reset=standing, episode_s=2 * config.seconds)
    env = LeggedEnv(
        spec, task, count + max(8, count // 4), seed=context.seed, device=context.device
    )
    upright = torch.ones(env.num_worlds, dtype=torch.bool, device=env.device)
    rows, targets, errors, settled = [(env.physics.qpos, env.state)], [], [], []
    for step in range(steps):
        command = env.command.clone()
        action = policy(env.observe())
        targets.append(env.default_joint_pos + task.action_scale * action)
        outcome = env.step(action)
        upright &= ~outcome.fell
        rows.append((env.physics.qpos, env.state))
        if step >= settle:
            errors.append(_tracking_error(env, command))
            settled.append(errors[-1][(env.command != command).any(dim=-1)])
    kept = torch.nonzero(upright).flatten()
    skill = SKILLS[task_name]
    if len(kept) < count:
        raise StageError(
            f"the {skill} expert fell in {env.num_worlds - len(kept)} of {env.num_worlds} "
            "recordings; train it longer"
        )
    settled = torch.cat(settled)
    figures = {
        f"{skill}_error_mean": float(torch.stack(errors).mean()),
        # At the last moment of each command; the mean above includes the way there.
        f"{skill}_error_settled": float(settled.mean()) if len(settled) else None,
        f"{skill}_falls": float((~upright).sum()),
        f"{skill}_worlds": float(env.num_worlds),
    }
    weight = config.reach_weight if skill == "reach" else 1.0
    asked = torch.stack([*targets, targets[-1]], dim=1).cpu().numpy()
    chosen = enumerate(kept[:count].tolist())
    return [
        _clip(spec, skill, weight, index, rows, asked[world], world) for index, world in chosen
    ], figures


def _tracking_error(env: LeggedEnv, command: torch.Tensor) -> torch.Tensor:
    """(N,) planar velocity error [m/s] of a walking task, end-effector error [m] of a reaching one,
    for ``command`` (N, 3).
    """
    reached = env.state.lin_vel_b[:, :2] if env.task.name == "walk" else env.end_effector()
    return torch.linalg.vector_norm(reached - command[:, : reached.shape[1]], dim=-1)


def _clip(
    spec: RobotSpec,
    skill: str,
    weight: float,
    index: int,
    rows: list,
    joint_target: np.ndarray,
    world: int,
) -> Clip:
    def series(pick: Callable) -> torch.Tensor:
        return torch.stack([pick(qpos, state)[world] for qpos, state in rows]).cpu().numpy()

    return Clip(
        name=f"{skill}_{index:03d}",
        fps=1.0 / CONTROL_DT,
        joint_names=spec.joint_names,
        root_pos=series(lambda qpos, _: qpos[:, :3]),
        root_quat=series(lambda qpos, _: qpos[:, 3:7]),
        root_lin_vel_b=series(lambda _, state: state.lin_vel_b),
        root_ang_vel_b=series(lambda _, state: state.ang_vel_b),
        joint_pos=series(lambda qpos, _: qpos[:, 7:]),
        joint_vel=series(lambda _, state: state.joint_vel),
        joint_target=joint_target,
        skill=skill,
        weight=weight,
        source=f"lacoloco generate: {skill} expert",
        licence=LICENCE,
    )
