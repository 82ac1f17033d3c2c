"""Segments of a rollout that become clips: without early terminations, without long rests.

Frames of a rollout are numbered 0 to T; step t leads from frame t to frame t + 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import torch

from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.tracking.config import RecordingConfig
from lacoloco.robots.numbers import TrackingTolerances


def split_at_terminations(
    terminated: torch.Tensor, standing: bool, config: RecordingConfig
) -> Iterator[tuple[int, int]]:
    """Frames [start, stop) between the early terminations of one rollout.

    Args:
        terminated: (T,) bool per control step.
        standing: Whether the rollout starts in the default pose, without a transient.
        config: What is cut after a reset and before an early termination.
    """
    transient, before, shortest = (
        round(seconds / CONTROL_DT)
        for seconds in (config.transient_s, config.before_termination_s, config.min_segment_s)
    )
    start = 0 if standing else transient
    ends = (torch.nonzero(terminated).flatten() + 1).tolist()
    rollout_end = len(terminated) + 1 + before  # nothing is cut there
    for end in [*ends, rollout_end]:
        if end - before - start > shortest:
            yield start, end - before
        start = end + transient


def cut_rests(
    resting: np.ndarray, span: tuple[int, int], config: RecordingConfig
) -> Iterator[tuple[int, int]]:
    """What is left of the frames [start, stop) of ``span`` without the middle of every long rest.

    Args:
        resting: (T + 1,) bool per frame of the rollout.
        span: Frames [start, stop).
        config: How much of a rest is kept at either end.
    """
    start, stop = span
    keep, shortest = round(config.rest_s / CONTROL_DT), round(config.min_segment_s / CONTROL_DT)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], resting[start:stop].astype(int), [0]))))
    for rest_start, rest_stop in start + edges.reshape(-1, 2):
        if rest_stop - rest_start > 2 * keep:
            if rest_start + keep - start > shortest:
                yield start, int(rest_start + keep)
            start = int(rest_stop - keep)
    if stop - start > shortest:
        yield start, stop


def is_resting(series: Mapping[str, np.ndarray], limits: TrackingTolerances) -> np.ndarray:
    """(..., T + 1) bool, where a robot hardly moves.

    Args:
        series: ``root_lin_vel_b`` (..., T + 1, 3) [m/s] and ``joint_vel`` (..., T + 1, J) [rad/s].
        limits: Speeds of base and joints below which the robot rests.
    """
    planar = np.linalg.norm(series["root_lin_vel_b"][..., :2], axis=-1)
    joints = np.abs(series["joint_vel"]).mean(axis=-1)
    return (planar < limits.resting_speed) & (joints < limits.resting_joint_speed)
