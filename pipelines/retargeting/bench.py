"""How fast the paper's program is solved, next to the same program built anew for every frame."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lacoloco.datasets.mocap import load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.retargeting.pose_problem import PoseProblem, pose_program
from lacoloco.pipelines.retargeting.solver import WARM, Solver
from lacoloco.robots.registry import load_robot
from lacoloco.robots.spec import RobotSpec

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
        `frames` per round, `frames_per_second`, `build_seconds`, `rebuilt_frames_per_second` and
        `ratio_to_engine`, the first rate over the second.

    Raises:
        RobotError: Unknown robot.
        DatasetError: A file that cannot be read.
    """
    spec = load_robot(robot)
    clips = [load_bvh(Path(path)).keypoints(list(spec.keypoints)) for path in sources or [DOG_BVH]]
    began = time.process_time()
    problem = PoseProblem(spec)
    build = time.process_time() - began
    frames = sum(len(clip) for clip in clips)
    seconds = min(_seconds(problem, clips) for _ in range(rounds))
    rebuilt = _rebuilt_rate(spec, problem, clips[0][:REBUILT])
    return {
        "frames": frames,
        "frames_per_second": frames / seconds,
        "build_seconds": build,
        "rebuilt_frames_per_second": rebuilt,
        "ratio_to_engine": frames / seconds / rebuilt,
    }


def _seconds(problem: PoseProblem, clips: Sequence[np.ndarray]) -> float:
    began = time.process_time()
    for clip in clips:
        problem.track(clip)
    return time.process_time() - began


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
