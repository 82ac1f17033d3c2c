"""Is this a motion of an animal on its legs? What files get wrong, found by looking at the points.

Two directions say where up is: from the paws to the hips, and forward x left of the trunk. An
animal that lies or leaps disagrees with one of them for a while; a wrong axis turns both.
"""

from __future__ import annotations

import numpy as np

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import Mocap, UpAxis, axis_of_file
from lacoloco.pipelines.retargeting.findings import Finding
from lacoloco.pipelines.retargeting.mocap.body_map import BodyMap, LegGeometry
from lacoloco.pipelines.retargeting.mocap.frame_rate import likely_rate
from lacoloco.pipelines.retargeting.mocap.posture import unlike
from lacoloco.pipelines.retargeting.mocap.reading import Reading

SHORTEST, LONGEST = 0.03, 4.0
"""m: limbs of a mouse and more than those of a giraffe."""
USUAL = 0.45
"""m: limbs of a dog, from which a unit is guessed for the message."""
MOST_UNLIKE = 2.4
"""Times that limbs may be longer or shorter than usual ones: a child's, a giant's, no inches."""
UNITS = {
    "metres": 1.0,
    "centimetres": 0.01,
    "millimetres": 0.001,
    "inches": 0.0254,
    "CMU's units": 0.056444,
}
CLEARLY = 0.7
"""Cosine from which a direction counts as that of an axis."""
SLOWEST = 20.0
"""frames/s below which steps of a trot fall between the frames."""


def check_recording(
    mocap: Mocap,
    mapping: BodyMap,
    legs: LegGeometry,
    reading: Reading,
    file: str,
    *,
    usual_limb: float = 0.0,
    own_map: bool = False,
    hint: str = "",
) -> list[Finding]:
    """Look for what is wrong with a recording.

    Args:
        mocap: With z up, in metres, at the rate of its file.
        mapping: Its limbs, and the robot's.
        legs: Of the robot: which limbs are front and left.
        reading: How it was read.
        file: What to call it.
        usual_limb: Length of the limbs of such bodies, m; 0 where they differ.
        own_map: Whether a person chose the map, so that an unlike body is only a finding.
        hint: What else the joints fit, for the message about another kind of body.

    Returns:
        What was found.

    Raises:
        DatasetError: Wrong scale, wrong axis, upside down, another kind of body, one frame: nothing
            could come of it. The message says what to do.
    """
    if mocap.frames < 2:
        raise DatasetError(f"{file}: has one frame; a motion needs at least two")
    limb = _check_scale(mocap, mapping, file, reading.unit, usual_limb)
    findings = [Finding("frame_count", remark) for remark in mocap.remarks]
    legs_up, trunk_up = up_directions(mocap, mapping, legs)
    _check_axis(legs_up, trunk_up, file, reading.up_axis)
    if reason := unlike(mocap, mapping, legs):
        if not own_map:
            raise DatasetError(
                f"{file}: this is no body like the robot's: {reason}; if it is meant, name the map"
                f" of its joints with --map{hint}"
            )
        findings.append(Finding("unlike", reason))
    if legs_up[2] > 0.2 and trunk_up[2] < -0.2:
        findings.append(
            Finding(
                "sides_swapped",
                "its left limbs are on the right of the trunk: left and right seem to be exchanged;"
                " if so, --swap-sides",
            )
        )
    return findings + _rate_findings(mocap, mapping, limb, reading)


def _rate_findings(mocap: Mocap, mapping: BodyMap, limb: float, reading: Reading) -> list[Finding]:
    findings = []
    used = min(mocap.fps, reading.fps or mocap.fps)
    if used < SLOWEST:
        text = f"has {used:.3g} frames per second; steps may fall between them"
        findings.append(Finding("few_frames", text))
    elif not reading.source_fps and (likely := likely_rate(mocap, mapping, limb)):
        rate, reason = likely
        text = f"{reason}: the file's frame time may be wrong; --source-fps {rate:g} if it is"
        findings.append(Finding("frame_rate", text))
    return findings


def up_directions(
    mocap: Mocap, mapping: BodyMap, legs: LegGeometry
) -> tuple[np.ndarray, np.ndarray]:
    """Means (3,) over the clip of the directions from paws to hips, and of forward x left, or
    from the hips to the arms where nothing tells what is forward.

    Their length tells how steady they are.
    """
    hips, paws = mocap.keypoints(mapping.hips), mocap.keypoints(mapping.limb_ends(mocap))
    front, left = legs.hips[:, 0] > legs.hips[:, 0].mean(), legs.hips[:, 1] > 0
    legs_up = _mean_direction(hips.mean(1) - paws.mean(1))
    if mapping.soles:  # two hips do not tell where the front is; feet do
        forward = (paws[:, 1::2] - paws[:, ::2]).mean(1)
    elif mapping.arms:  # nothing does: up is where the arms are
        roots = mocap.keypoints([mapping.joints[arm[0]] for arm in mapping.arms])
        return legs_up, _mean_direction(roots.mean(1) - hips.mean(1))
    else:
        forward = hips[:, front].mean(1) - hips[:, ~front].mean(1)
    aside = hips[:, left].mean(1) - hips[:, ~left].mean(1)
    return legs_up, _mean_direction(np.cross(forward, aside))


def _check_scale(
    mocap: Mocap, mapping: BodyMap, file: str, unit: float, usual_limb: float
) -> float:
    """Length of the limbs, m."""
    length = mapping.limb_length(mocap)
    shortest, longest = SHORTEST, LONGEST
    if usual_limb:
        shortest, longest = usual_limb / MOST_UNLIKE, usual_limb * MOST_UNLIKE
    if shortest <= length <= longest:
        return length
    if length <= 0.0:
        raise DatasetError(f"{file}: its limbs have no length")
    usual = usual_limb or USUAL
    name, right = min(UNITS.items(), key=lambda item: abs(np.log(length / unit * item[1] / usual)))
    who = "person" if mapping.arms else "animal"
    raise DatasetError(
        f"{file}: limbs of {length:.3g} m are no {who}'s; it seems to be in {name}: give"
        f" --unit {right:g} instead of {unit:g}"
    )


def _check_axis(legs_up: np.ndarray, trunk_up: np.ndarray, file: str, up_axis: UpAxis) -> None:
    """A wrong axis turns limbs and trunk alike; exchanged sides turn the trunk alone."""
    axis = int(np.argmax(np.abs(legs_up)))
    sign = 1 if legs_up[axis] > 0 else -1
    if min(abs(legs_up[axis]), abs(trunk_up[axis])) < CLEARLY or (axis, sign) == (2, 1):
        return
    what = "upside down" if axis == 2 else "on its side all the time"
    right = axis_of_file(up_axis, axis, sign)
    raise DatasetError(
        f"{file}: the animal is {what}; its legs say that the file's {right} axis is up, not"
        f" {up_axis}: give --up-axis={right}"
    )


def _mean_direction(vectors: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return (vectors / np.maximum(lengths, 1e-9)).mean(0)
