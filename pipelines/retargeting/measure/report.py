"""One picture per clip from which a person judges it: the robot in colour, the animal in grey."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lacoloco.pipelines.retargeting.measure.assessment import Assessment
from lacoloco.pipelines.retargeting.measure.quality import horizontal_speed
from lacoloco.pipelines.retargeting.solve.pose_problem import retarget_bounds
from lacoloco.pipelines.retargeting.targets.contacts import phases

ROBOT, ANIMAL, LIMIT = "#1f5fa8", "#9a9a9a", "#c0392b"
FEET = ("#1f5fa8", "#d98c1f", "#2e8b57", "#8e44ad")
LINE = 0.9
SIZE, DPI = (13.0, 14.0), 90


def write_report(path: Path, assessment: Assessment, metrics: Mapping[str, Any]) -> None:
    """Draw a clip and write it as PNG.

    Args:
        path: The file; its folder exists.
        assessment: The clip.
        metrics: Those of `Retargeted.metrics`.
    """
    figure = Figure(figsize=SIZE, dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(5, 2)
    time = np.arange(assessment.clip.frames) / assessment.clip.fps
    for axis, panel in zip(axes.ravel(), PANELS, strict=True):
        panel(axis, time, assessment)
        axis.set_xlim(0.0, max(float(time[-1]), 1e-3))
        axis.margins(y=0.08)
        axis.spines[["top", "right"]].set_visible(False)
        axis.title.set_fontsize(10)
        axis.title.set_horizontalalignment("left")
        axis.title.set_position((0.0, 1.0))
    for axis in axes[-1]:
        axis.set_xlabel("s")
    figure.suptitle(_headline(metrics, assessment), fontsize=11, x=0.01, ha="left")
    figure.savefig(path, format="png")


def _headline(metrics: Mapping[str, Any], assessment: Assessment) -> str:
    hits = metrics["joint_limit_hits"] + metrics["joint_speed_hits"]
    return (
        f"{metrics['name']}: {metrics['frames']} frames at {assessment.clip.fps:.0f}/s,"
        f" {assessment.spec.name}, animal x {metrics['scale']:.3f}\n"
        f"keypoint error {100 * metrics['keypoint_error_mean_m']:.1f} cm"
        f" (95 % below {100 * metrics['keypoint_error_p95_m']:.1f}),"
        f" skate {100 * metrics['foot_skate_mean_m_s']:.2f} cm/s,"
        f" sunk {1000 * metrics['ground_penetration_max_m']:.2f} mm,"
        f" floating {1000 * metrics['stance_float_max_m']:.2f} mm,"
        f" contacts {100 * metrics['contact_agreement']:.1f} % as the animal's\n"
        f"{hits} limit hits, acceleration up to {metrics['joint_acceleration_peak']:.0f} rad/s^2,"
        f" torques 95 % below {metrics['torque_share_p95']:.2f} of the limit,"
        f" {metrics['solver_failures']} frames the solver failed"
    )


def _keypoints(axis: Axes, time: np.ndarray, clip: Assessment) -> None:
    error = 100 * np.linalg.norm(clip.keypoints - clip.targets.points, axis=-1)
    axis.fill_between(time, error.min(1), error.max(1), color=ROBOT, alpha=0.2, lw=0)
    axis.plot(time, error.mean(1), color=ROBOT, lw=LINE)
    axis.set_ylim(bottom=0.0)
    axis.set_title("keypoint error, cm: mean, and from the best to the worst keypoint")


def _contacts(axis: Axes, time: np.ndarray, clip: Assessment) -> None:
    feet = clip.spec.foot_points
    for offset, contacts, colors in (
        (0.22, clip.targets.contacts, [ANIMAL] * len(feet)),
        (-0.22, clip.contacts, FEET),
    ):
        for foot, start, stop in phases(contacts):
            where = (len(feet) - 1 - foot + offset, 0.36)
            span = (start / clip.clip.fps, (stop - start) / clip.clip.fps)
            color = colors[foot % len(colors)]
            axis.broken_barh([span], (where[0] - where[1] / 2, where[1]), color=color, lw=0)
    axis.set_yticks(range(len(feet)), feet[::-1])
    axis.set_ylim(-0.6, len(feet) - 0.4)
    axis.set_title("standing: animal (grey) above robot (colour)")


def _height(axis: Axes, time: np.ndarray, clip: Assessment) -> None:
    robot, animal = clip.courses
    axis.plot(time, 100 * animal[:, 2], color=ANIMAL, lw=2 * LINE, label="animal, scaled")
    axis.plot(time, 100 * robot[:, 2], color=ROBOT, lw=LINE, label="robot")
    axis.legend(loc="upper right", fontsize=8, framealpha=0.8, edgecolor="none", ncols=2)
    axis.set_title("height of the middle of the hips, cm")


def _speed(axis: Axes, time: np.ndarray, clip: Assessment) -> None:
    robot, animal = (horizontal_speed(course, clip.clip.fps) for course in clip.courses)
    axis.plot(time, animal, color=ANIMAL, lw=2 * LINE)
    axis.plot(time, robot, color=ROBOT, lw=LINE)
    axis.set_ylim(bottom=0.0)
    axis.set_title("speed over ground, m/s")


def _gap(axis: Axes, time: np.ndarray, clip: Assessment) -> None:
    gap = 100 * (clip.feet[..., 2] - clip.spec.foot_radius())
    _per_foot(axis, time, gap, clip.spec.foot_points)
    axis.axhline(0.0, color=LIMIT, lw=LINE)
    axis.set_ylim(min(-0.5, 1.1 * gap.min()), max(2.0, 1.1 * gap.max()))
    axis.legend(loc="upper right", fontsize=8, framealpha=0.8, edgecolor="none", ncols=4)
    axis.set_title("air below each foot, cm: negative is sunk")


def _skate(axis: Axes, time: np.ndarray, clip: Assessment) -> None:
    speed = 100 * np.linalg.norm(np.diff(clip.feet[..., :2], axis=0), axis=-1) * clip.clip.fps
    standing = clip.targets.contacts[1:] & clip.targets.contacts[:-1]
    speed = np.where(standing, speed, np.nan)
    _per_foot(axis, time[1:], speed, clip.spec.foot_points)
    axis.axhline(1.0, color=LIMIT, lw=LINE, ls=":")
    axis.set_ylim(0.0, max(1.2, 1.1 * np.nanmax(speed, initial=0.0)))
    axis.set_title("speed of standing feet over ground, cm/s (dotted: 1)")


def _range(axis: Axes, time: np.ndarray, clip: Assessment) -> None:
    lower, upper = retarget_bounds(clip.spec)
    share = 2 * (clip.clip.joint_pos - lower) / (upper - lower) - 1
    axis.plot(time, share, color=ROBOT, lw=0.5, alpha=0.6)
    _limits(axis, (-1.0, 1.0), np.abs(share).max())
    axis.set_title("joints within their range, -1 to 1")


def _joint_speed(axis: Axes, time: np.ndarray, clip: Assessment) -> None:
    share = np.diff(clip.clip.joint_pos, axis=0) * clip.clip.fps / clip.spec.velocity_limits
    axis.plot(time[1:], share, color=ROBOT, lw=0.5, alpha=0.6)
    _limits(axis, (-1.0, 1.0), np.abs(share).max(initial=0.0))
    axis.set_title("joint speeds, share of the limit")


def _acceleration(axis: Axes, time: np.ndarray, clip: Assessment) -> None:
    rates = np.abs(np.diff(clip.clip.joint_pos, 2, axis=0)) * clip.clip.fps**2
    if len(rates):
        axis.fill_between(time[1:-1], 0.0, rates.max(1), color=ROBOT, alpha=0.2, lw=0)
        axis.plot(time[1:-1], rates.mean(1), color=ROBOT, lw=LINE)
    axis.set_ylim(bottom=0.0)
    axis.set_title("joint accelerations, rad/s^2: mean and greatest")


def _torque(axis: Axes, time: np.ndarray, clip: Assessment) -> None:
    share = clip.torque_share
    missing = clip.efforts.missing / clip.spec.weight()
    axis.plot(time, missing, color=ANIMAL, lw=LINE, label="force the ground cannot give / weight")
    axis.plot(time, share.max(1), color=ROBOT, lw=LINE, label="greatest torque / limit")
    axis.axhline(1.0, color=LIMIT, lw=LINE)
    reached = np.percentile(np.maximum(share.max(1), missing), 99.5)  # a landing may be a spike
    axis.set_ylim(0.0, max(1.2, 1.1 * reached))
    axis.legend(loc="upper right", fontsize=8, framealpha=0.8, edgecolor="none", ncols=2)
    axis.set_title("inverse dynamics")


def _per_foot(axis: Axes, time: np.ndarray, series: np.ndarray, feet: tuple[str, ...]) -> None:
    for index, foot in enumerate(feet):
        color = FEET[index % len(FEET)]
        axis.plot(time, series[:, index], color=color, lw=LINE, label=foot.removesuffix("_FOOT"))


def _limits(axis: Axes, limits: tuple[float, float], reached: float) -> None:
    for limit in limits:
        axis.axhline(limit, color=LIMIT, lw=LINE)
    axis.set_ylim(-1.1 * max(reached, 1.0), 1.1 * max(reached, 1.0))


PANELS = (
    *(_keypoints, _contacts, _height, _speed, _gap),
    *(_skate, _range, _joint_speed, _acceleration, _torque),
)
