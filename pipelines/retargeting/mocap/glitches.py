"""Jumps in a recording: markers that were lost, a pose for binding, two takes in one file.

They are looked for in the file as it is, so that its own frames are named, and before anything
smooths or resamples them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lacoloco.datasets.mocap import Mocap
from lacoloco.pipelines.retargeting.findings import Finding
from lacoloco.pipelines.retargeting.mocap.body_map import BodyMap

USUAL_SHARE = 90
"""Percentile of the clip's own steps that jumps are measured by."""
TIMES_USUAL = 4.0
"""Steps that many times as long as usual are jumps. The wildest of ten recorded dogs has 1.8."""
SHORTEST = 0.3
"""A step shorter than that share of a limb is no jump, however still the animal lies."""
MOST_NAMED = 5


def without_glitches(
    raw: Mocap, mapping: BodyMap, part: tuple[int, int]
) -> tuple[Mocap, list[Finding]]:
    """Put single frames that lie off between their neighbours, and name jumps.

    Args:
        raw: A recording as its file is; any unit.
        mapping: Its limbs.
        part: First frame that is used, and the frame after the last.

    Returns:
        The recording, and what was found in that part.
    """
    if raw.frames < 2:
        return raw, []
    nodes = (*mapping.hips, *mapping.limb_ends(raw))
    limb = mapping.limb_length(raw)
    usual = float(np.percentile(_steps(raw, nodes), USUAL_SHARE))
    threshold = max(TIMES_USUAL * usual, SHORTEST * limb)
    raw, frames = mended(raw, nodes, threshold)
    findings, (start, stop) = [], part
    if frames := [frame for frame in frames if start <= frame < stop]:
        named = ", ".join(str(frame) for frame in frames)
        text = f"frames that lay off were replaced by the mean of their neighbours: {named}"
        findings.append(Finding("mended", text))
    jumps = np.flatnonzero(_steps(raw, nodes) > threshold).tolist()
    if jumps := [step for step in jumps if start <= step < stop - 1]:
        findings.append(Finding("jump", describe_jumps(jumps, part)))
    return raw, findings


def mended(mocap: Mocap, nodes: tuple[str, ...], threshold: float) -> tuple[Mocap, list[int]]:
    """Put single frames that lie off between those before and after them.

    Args:
        mocap: A recording.
        nodes: Nodes whose steps count.
        threshold: Length of a step from which it is a jump, in units of the recording.

    Returns:
        The recording, and which frames were replaced by the mean of their neighbours.
    """
    jumps = _steps(mocap, nodes) > threshold
    points, found = mocap.positions.copy(), []
    for frame in (np.flatnonzero(jumps[:-1] & jumps[1:]) + 1).tolist():
        before, after = points[frame - 1], mocap.positions[frame + 1]
        if np.linalg.norm(after - before, axis=-1).max() < threshold:
            points[frame] = 0.5 * (before + after)
            found.append(frame)
    return (replace(mocap, positions=points) if found else mocap), found


def describe_jumps(jumps: list[int], part: tuple[int, int]) -> str:
    """One line that names the jumps, and the stretch between two of them that is longest."""
    ends = [part[0], *(step + 1 for step in jumps), part[1]]
    start, stop = max(zip(ends[:-1], ends[1:], strict=True), key=lambda pair: pair[1] - pair[0])
    named = ", ".join(f"{step} to {step + 1}" for step in jumps[:MOST_NAMED])
    more = f" and {len(jumps) - MOST_NAMED} more" if len(jumps) > MOST_NAMED else ""
    return (
        f"it jumps from frame {named}{more}; --trim {start}:{stop} is the longest part without one"
    )


def _steps(mocap: Mocap, nodes: tuple[str, ...]) -> np.ndarray:
    """(T - 1,) longest way of a node from each frame to the next, in units of the recording."""
    return np.linalg.norm(np.diff(mocap.keypoints(nodes), axis=0), axis=-1).max(axis=1)
