"""How fast retargeting is, next to the paper's program built anew for every frame; and how good.

Both modes follow the same targets: the animal fitted to the robot.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import Mocap, load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.retargeting.config import RetargetConfig
from lacoloco.pipelines.retargeting.mocap.body_map import body_map, leg_geometry
from lacoloco.pipelines.retargeting.solve.clip_problem import ClipProblem, ClipWeights
from lacoloco.pipelines.retargeting.solve.pose_problem import PoseProblem, pose_program
from lacoloco.pipelines.retargeting.solve.solver import COLD, WARM, Solver
from lacoloco.pipelines.retargeting.targets.targets import fitted_targets
from lacoloco.pipelines.retargeting.worker import Task, Worker
from lacoloco.robots.registry import load_robot
from lacoloco.robots.spec import RobotSpec

Result = TypeVar("Result")

REBUILT = 60
"""Frames for which the program is built anew."""
LEAST_SKATE = 1e-6
"""m/s below which skate is rounding."""
CLIP_ONLY = (
    *("ground_penetration_max_m", "stance_float_max_m", "contact_agreement"),
    *("joint_limit_hits", "joint_speed_hits", "solver_failures"),
)
BOTH = {
    "keypoint_error_mean_m": "error",
    "foot_skate_mean_m_s": "skate",
    "joint_jerk_peak": "jerk",
    "torque_share_p95": "torque",
}
"""Figures that are compared, and what they are called here."""


def bench_retarget(robot: str, sources: Sequence[Path] = (), rounds: int = 3) -> dict[str, float]:
    """Measure, on one core and in processor time, so that other work on the machine counts little.

    Args:
        robot: Name of the robot.
        sources: BVH files; default: the bundled dog.
        rounds: Repetitions; the fastest counts.

    Returns:
        `frames` per round; for the paper's mode `frames_per_second`, `build_seconds`,
        `rebuilt_frames_per_second` and `ratio_to_engine`, the first rate over the last; for clips
        as a whole `clip_frames_per_second` and `clip_times_real_time`, everything included.

    Raises:
        RobotError: Unknown robot.
        DatasetError: A file that cannot be read.
    """
    spec = load_robot(robot)
    clips = [load_bvh(Path(path)) for path in sources or [DOG_BVH]]
    targets = [clip.keypoints(list(spec.keypoints)) for clip in clips]
    frames = sum(clip.frames for clip in clips)
    build, problem = _timed(lambda: PoseProblem(spec))
    seconds = _fastest(lambda: [problem.track(points) for points in targets], rounds)
    rebuilt = _rebuilt_rate(spec, problem, targets[0][:REBUILT])
    whole = _fastest(_whole_clips(spec, clips), rounds)
    return {
        "frames": frames,
        "frames_per_second": frames / seconds,
        "build_seconds": build,
        "rebuilt_frames_per_second": rebuilt,
        "ratio_to_engine": frames / seconds / rebuilt,
        "clip_frames_per_second": frames / whole,
        "clip_times_real_time": sum(clip.duration for clip in clips) / whole,
    }


def usable(robot: str, sources: Sequence[Path]) -> tuple[list[Path], list[str]]:
    """The files that can be retargeted, and what is wrong with the others, one line each.

    Raises:
        RobotError: Unknown robot.
        StageError: No map leads to it.
    """
    worker, good, bad = Worker(RetargetConfig(mode="paper"), robot), [], []
    for path in sources:
        try:
            worker.read(Task(path, path.stem))
            good.append(path)
        except DatasetError as error:
            bad.append(str(error))
    return good, bad


def compare_modes(robot: str, sources: Sequence[Path] = ()) -> list[dict[str, Any]]:
    """Retarget files in both modes and put their metrics side by side.

    Args:
        robot: Name of the robot.
        sources: BVH files; default: the bundled dog.

    Returns:
        One row per file: name, frames, `times_real_time` of mode clip on one core, and metrics of
        both modes; `error_ratio` is clip over paper, `skate_ratio` paper over clip.

    Raises:
        RobotError: Unknown robot.
        DatasetError: A file that cannot be read, or fits no map.
    """
    rows = []
    workers = [Worker(RetargetConfig(mode=mode, scale="auto"), robot) for mode in ("clip", "paper")]
    for path in sources or [DOG_BVH]:
        clip, paper = (_metrics(worker, Task(Path(path), Path(path).stem)) for worker in workers)
        row = {key: clip[key] for key in ("name", "frames", "times_real_time", *CLIP_ONLY)}
        for key, name in BOTH.items():
            row[f"clip_{name}"], row[f"paper_{name}"] = clip[key], paper[key]
        row["error_ratio"] = _ratio(row["clip_error"], row["paper_error"])
        row["skate_ratio"] = _ratio(row["paper_skate"], max(row["clip_skate"], LEAST_SKATE))
        rows.append(row)
    return rows


def verdicts(rows: Sequence[Mapping[str, Any]], speed: Mapping[str, float]) -> list[dict[str, Any]]:
    """What retargeting must show, the worst of what it showed, and whether that is enough.

    Args:
        rows: From `compare_modes`.
        speed: From `bench_retarget` and `other_starts`.
    """
    hits = [row["joint_limit_hits"] + row["joint_speed_hits"] for row in rows]
    shown = [
        ("paper mode, frames/s", ">=", 900.0, speed["frames_per_second"]),
        ("paper mode, ratio to rebuilding", ">=", 7.0, speed["ratio_to_engine"]),
        ("paper mode, cost above other starts, m^2", "<=", 1e-6, speed["worst_excess_m2"]),
        ("clip mode, x real time", ">=", 10.0, min(row["times_real_time"] for row in rows)),
        ("skate of paper over clip", ">=", 5.0, min(row["skate_ratio"] for row in rows)),
        ("skate, m/s", "<=", 0.01, max(row["clip_skate"] for row in rows)),
        ("penetration, m", "<=", 1e-3, max(row["ground_penetration_max_m"] for row in rows)),
        (
            "gap below a standing foot, m",
            "<=",
            3e-3,
            max(row["stance_float_max_m"] for row in rows),
        ),
        ("keypoint error, clip over paper", "<=", 1.2, max(row["error_ratio"] for row in rows)),
        ("contacts as the animal's", ">=", 0.95, min(row["contact_agreement"] for row in rows)),
        ("limit hits", "<=", 0, max(hits)),
        (
            "jerk peak, clip over paper",
            "<=",
            1.0,
            max(_ratio(row["clip_jerk"], row["paper_jerk"]) for row in rows),
        ),
    ]
    return [
        {
            "what": what,
            "must": f"{sign} {bound:g}",
            "worst": worst,
            "met": bool(worst >= bound if sign == ">=" else worst <= bound),
        }
        for what, sign, bound, worst in shown
    ]


def other_starts(
    robot: str, sources: Sequence[Path] = (), every: int = 50, starts: int = 4
) -> dict[str, float]:
    """Compare the paper's mode with independent solves of single frames.

    Args:
        robot: Name of the robot.
        sources: BVH files; default: the bundled dog.
        every: Every how many frames one is solved from elsewhere.
        starts: How many starts: the neutral pose, then random ones around it.

    Returns:
        `frames_checked`, and `worst_excess_m2`, by how much the cost of the followed minimum is at
        most above the best of the others.
    """
    spec = load_robot(robot)
    problem, solver = PoseProblem(spec), Solver(pose_program(spec, 0.005), COLD)
    rng, excess = np.random.default_rng(0), []
    for path in sources or [DOG_BVH]:
        points = load_bvh(Path(path)).keypoints(list(spec.keypoints))
        cost = problem.track(points).cost
        for frame in range(0, len(points), every):
            position, quat, joints = problem.neutral_pose(points[frame])
            found = []
            for start in range(starts):
                spread = rng.normal(0.0, 0.5, spec.num_joints) if start else 0.0
                guess = np.concatenate([position, np.zeros(3), joints + spread])
                found.append(solver.solve(guess, np.concatenate([quat, points[frame].ravel()])))
            best = min((other.cost for other in found if other is not None), default=np.inf)
            excess.append(float(cost[frame] - best))
    return {"frames_checked": len(excess), "worst_excess_m2": max(excess)}


def _metrics(worker: Worker, task: Task) -> dict[str, Any]:
    mocap, _, retargeter, _ = worker.read(task)
    result = retargeter.clip(mocap, task.name)
    speed = result.clip.duration / max(result.seconds, 1e-9)
    return {**result.metrics(), "times_real_time": speed}


def _ratio(above: float, below: float) -> float:
    return above / below if below else float(above > 0)


def _whole_clips(spec: RobotSpec, clips: Sequence[Mocap]) -> Callable[[], object]:
    mapping = body_map(spec)
    legs, radius = leg_geometry(spec, mapping), spec.foot_radius()
    problem = ClipProblem(spec, mapping, legs, ClipWeights())

    def solve() -> None:
        for clip in clips:
            problem.track(fitted_targets(clip, mapping, legs, radius), clip.fps)

    return solve


def _timed(work: Callable[[], Result]) -> tuple[float, Result]:
    began = time.process_time()
    result = work()
    return time.process_time() - began, result


def _fastest(work: Callable[[], object], rounds: int) -> float:
    return min(_timed(work)[0] for _ in range(rounds))


def _rebuilt_rate(spec: RobotSpec, problem: PoseProblem, targets: np.ndarray) -> float:
    """Frames per second when each frame derives and builds its solver, from the same guesses.

    The kinematics are built once, as in the original, so that the ratio flatters nobody.
    """
    motion, program = problem.track(targets), pose_program(spec, 0.005)
    began = time.process_time()
    for index, target in enumerate(targets[1:]):
        solver = Solver(program, WARM)
        guess = np.concatenate([motion.root_pos[index], np.zeros(3), motion.joint_pos[index]])
        solver.solve(guess, np.concatenate([motion.root_quat[index], target.ravel()]))
    return (len(targets) - 1) / (time.process_time() - began)
