"""The task that a low level is trained on: imitation, in worlds that differ."""

from __future__ import annotations

from dataclasses import replace

from lacoloco.pipelines.evaluation.hardware_shift import IN_TRAINING
from lacoloco.pipelines.low_level.config import TrainLowConfig
from lacoloco.pipelines.sim.randomisation import widened
from lacoloco.pipelines.sim.tasks import Task, imitate_task
from lacoloco.robots.spec import RobotSpec


def training_task(spec: RobotSpec, config: TrainLowConfig) -> Task:
    """Imitation with the config's episodes, resets and pushes, and its shift."""
    task = imitate_task(spec, constrained=config.cat)
    around = widened(task.randomisation, config.randomisation)
    if around.push:
        around = replace(around, push=config.push, push_interval_s=config.push_every_s)
    task = replace(
        task,
        episode_s=config.episode_s,
        fall_tilt=spec.terminations.training_tilt,
        reset=replace(task.reset, clip_share=config.clip_share),
        randomisation=around,
    )
    return IN_TRAINING.apply(task) if config.shift else task
