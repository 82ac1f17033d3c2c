"""How fast retargeting is, next to the paper's program built anew for every frame."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from lacoloco.datasets.mocap import Mocap, load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.retargeting.body_map import body_map, leg_geometry
from lacoloco.pipelines.retargeting.clip_problem import ClipProblem, ClipWeights
from lacoloco.pipelines.retargeting.pose_problem import PoseProblem, pose_program
from lacoloco.pipelines.retargeting.solver import WARM, Solver
from lacoloco.pipelines.retargeting.targets import fitted_targets
from lacoloco.robots.registry import load_robot
from lacoloco.robots.spec import RobotSpec

Result = TypeVar("Result")

REBUILT = 60
"""Frames for which the program is built anew."""


def bench_retarget(
    robot: str = "solo12", sources: Sequence[Path] = (), rounds: int = 3
) -> dict[str, float]:
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
