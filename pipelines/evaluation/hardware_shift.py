"""The hardware shift: the same episodes in every row, each time with one thing as on a real robot.

Latencies are drawn around their mean in every control step, +-50 %. Those of actions are rounded
to physics steps of 3.3 ms so that their mean is kept. Randomisation, targets and pushes are those
of the first row.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from typing import Any

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation.episodes import Episodes, play_episodes
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.sim.tasks import Task
from lacoloco.pipelines.stage import SILENT, Progress
from lacoloco.robots.spec import RobotSpec

METRICS = (
    "success_5cm_pct",
    "success_30cm_pct",
    "ee_error_median_m",
    "ee_error_mean_m",
    "falls_pct",
    "contact_violation_pct",
    "contact_violation_original_pct",
)
JITTER = 0.5


@dataclass(frozen=True)
class ShiftRow:
    """One row of the table.

    Attributes:
        disturbances: Fields of :class:`lacoloco.pipelines.sim.disturbances.config.Disturbances`.
        randomisation: Fields of :class:`lacoloco.pipelines.sim.randomisation.Randomisation`.
        reset: Fields of :class:`lacoloco.pipelines.sim.tasks.ResetConfig`.
    """

    disturbances: Mapping[str, Any] = field(default_factory=dict)
    randomisation: Mapping[str, Any] = field(default_factory=dict)
    reset: Mapping[str, Any] = field(default_factory=dict)

    def apply(self, task: Task) -> Task:
        """The task with this row's change."""
        return replace(
            task,
            disturbances=replace(task.disturbances, **self.disturbances),
            randomisation=replace(task.randomisation, **self.randomisation),
            reset=replace(task.reset, **self.reset),
        )


def _late(name: str, milliseconds: int) -> ShiftRow:
    return ShiftRow({name: milliseconds / 1000.0, "latency_jitter": JITTER})


UNDISTURBED, EVERYTHING, OTHER_ENGINE = "undisturbed", "everything", "mujoco-warp"
_EXACT_CONTACTS = {"contact_time": (1.0, 1.0)}
_STIFF = ShiftRow({"contact_time": 0.004, "substeps": 10}, _EXACT_CONTACTS)
_MOCAP = {
    "mocap-filtered": ShiftRow({"mocap_filter": 0.02}),
    "mocap-delayed": ShiftRow({"mocap_delay": (0.01, 0.03)}),
    "mocap-dropouts": ShiftRow({"mocap_dropout": 0.05}),
}
_ONE_BY_ONE = {
    "stood-before": ShiftRow(reset={"stood_s": (0.2, 2.0)}),
    "noise": ShiftRow({"noise": 1.0}),
    **{f"action-latency-{ms}ms": _late("action_latency", ms) for ms in (5, 10, 20)},
    **{f"observation-latency-{ms}ms": _late("observation_latency", ms) for ms in (5, 10, 20)},
    "pd-1khz": ShiftRow({"explicit_pd": True, "substeps": 20}),
    "torque-speed": ShiftRow({"torque_speed": True}),
    "joint-friction": ShiftRow({"joint_friction": 0.02, "joint_damping": 0.1}),
    "gains": ShiftRow({"gain_error": 0.1}),
    "joint-offsets": ShiftRow({"joint_offset": 0.03}),
    **_MOCAP,
    "contact-stiff": _STIFF,
    "contact-soft": ShiftRow({"contact_time": 0.02}, _EXACT_CONTACTS),
    "friction": ShiftRow({}, {"friction": (0.3, 2.0)}),
    "slippery-foot": ShiftRow({"slippery_foot": 0.5}),
    "floor-tilt": ShiftRow({"floor_tilt": math.radians(3.0)}),
    "floor-steps": ShiftRow({"floor_steps": 0.01}),
    "payload": ShiftRow({"payload": 0.1}),
    "elliptic-cones": ShiftRow({"cone": "elliptic"}),
    "pgs": ShiftRow({"solver": "pgs"}),
}


def _together(left_out: Sequence[str], **more: Any) -> ShiftRow:
    """All rows at once but some, and what is disturbed beside them."""
    disturbances: dict[str, Any] = {}
    randomisation: dict[str, Any] = {}
    reset: dict[str, Any] = {}
    for name, row in _ONE_BY_ONE.items():
        if name not in left_out:
            disturbances |= row.disturbances
            randomisation |= row.randomisation
            reset |= row.reset
    return ShiftRow(disturbances | more, randomisation, reset)


_EVERYTHING = _together(
    (
        *("action-latency-5ms", "action-latency-20ms", "contact-soft", "pgs"),
        *("observation-latency-5ms", "observation-latency-20ms"),
    ),
    substeps=20,
)
"""One of each kind: 10 ms of both latencies, stiff contacts, physics and motors at 1 kHz."""
IN_TRAINING = _together(
    ("stood-before", "noise", "pd-1khz", "contact-stiff", "contact-soft", "pgs"), graded=True
)
"""What a policy can be trained with: all that needs no finer physics and can differ from world to
world, latencies of 20 ms. Noise and standing starts are settings of their own.
"""
HARDWARE = {
    UNDISTURBED: ShiftRow(),
    **_ONE_BY_ONE,
    OTHER_ENGINE: ShiftRow({"engine": "warp"}),
    EVERYTHING: _EVERYTHING,
}
"""Rows by name, in their order."""


def rows_here(wanted: Sequence[str] = ()) -> list[str]:
    """The rows that this machine can play, or those that are wanted.

    Raises:
        StageError: A wanted row is unknown.
    """
    for name in wanted:
        if name not in HARDWARE:
            raise StageError(f"shift_rows={name}: no such row; use {', '.join(HARDWARE)}")
    engine_here = find_spec("mujoco_warp") is not None
    return [
        name
        for name in HARDWARE
        if (name in wanted if wanted else name != OTHER_ENGINE or engine_here)
    ]


def hardware_shift(
    spec: RobotSpec,
    policies: Mapping[str, Policy],
    task: Task,
    rows: Sequence[str],
    *,
    episodes: int,
    worlds: int,
    seed: int,
    progress: Progress = SILENT,
) -> list[dict[str, Any]]:
    """Play every row's episodes.

    Returns:
        Per row ``name``, ``episodes``, the metrics, and ``intervals`` of them.
    """
    table = []
    for name in rows:
        progress.start(name, episodes)
        played = play_episodes(
            spec,
            policies,
            episodes,
            worlds=worlds,
            seed=seed,
            task=HARDWARE[name].apply(task),
            progress=progress,
        )
        progress.stop()
        table.append(_row(name, played))
    return table


def _row(name: str, played: Episodes) -> dict[str, Any]:
    metrics, intervals = played.metrics(), played.intervals()
    return {
        "name": name,
        "episodes": len(played.error),
        **{metric: metrics[metric] for metric in METRICS},
        "intervals": {metric: intervals[metric] for metric in METRICS},
    }
