"""Jumps in a recording: markers that were lost, a pose for binding, two takes in one file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lacoloco.datasets.mocap import Mocap

USUAL_SHARE = 90
"""Percentile of the clip's own steps that jumps are measured by."""
TIMES_USUAL = 4.0
"""Steps that many times as long as usual are jumps. The wildest of ten recorded dogs has 1.8."""
SHORTEST = 0.3
"""A step shorter than that share of a limb is no jump, however still the animal lies."""
MOST_NAMED = 5


def mended(mocap: Mocap, nodes: tuple[str, ...], limb: float) -> tuple[Mocap, list[int]]:
    """Put single frames that lie off between those before and after them.

    Args:
        mocap: A recording, in metres.
        nodes: Nodes whose steps count.
        limb: Length of a limb, m.

    Returns:
        The recording, and which frames were replaced by the mean of their neighbours.
    """
    found = []
    points, jumps = mocap.positions.copy(), set(jumping_steps(mocap, nodes, limb))
    threshold = _threshold(mocap, nodes, limb)
    for frame in range(1, mocap.frames - 1):
        if frame - 1 in jumps and frame in jumps:
            before, after = points[frame - 1], mocap.positions[frame + 1]
            if np.linalg.norm(after - before, axis=-1).max() < threshold:
                points[frame] = 0.5 * (before + after)
                found.append(frame)
    return (replace(mocap, positions=points) if found else mocap), found


def jumping_steps(mocap: Mocap, nodes: tuple[str, ...], limb: float) -> list[int]:
    """Frames after which some node jumps: it goes farther than the clip's own speeds explain."""
    steps = _steps(mocap, nodes)
    return np.flatnonzero(steps > _threshold(mocap, nodes, limb)).tolist()


def describe_jumps(jumps: list[int], frames: int) -> str:
    """One line that names the jumps, and the part between two of them that is longest."""
    ends = [0, *(step + 1 for step in jumps), frames]
    start, stop = max(zip(ends[:-1], ends[1:], strict=True), key=lambda part: part[1] - part[0])
    named = ", ".join(f"{step} to {step + 1}" for step in jumps[:MOST_NAMED])
    more = f" and {len(jumps) - MOST_NAMED} more" if len(jumps) > MOST_NAMED else ""
    return (
        f"it jumps from frame {named}{more}; --trim {start}:{stop} is the longest part without one"
    )


def _steps(mocap: Mocap, nodes: tuple[str, ...]) -> np.ndarray:
    """(T - 1,) longest way of a node from each frame to the next, m."""
    return np.linalg.norm(np.diff(mocap.keypoints(nodes), axis=0), axis=-1).max(axis=1)


def _threshold(mocap: Mocap, nodes: tuple[str, ...], limb: float) -> float:
    usual = float(np.percentile(_steps(mocap, nodes), USUAL_SHARE))
    return max(TIMES_USUAL * usual, SHORTEST * limb)
