"""The animal a clip came from, drawn in the size and place in which the robot follows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lacoloco.datasets.artifact import Artifact
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.hashing import hash_file
from lacoloco.datasets.mocap import Mocap
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.mocap.reading import Reading
from lacoloco.pipelines.retargeting.targets.contacts import ContactRule, stance_heights
from lacoloco.pipelines.viewing.recording import Recording
from lacoloco.robots.spec import RobotSpec


def with_animal(recording: Recording, artifact: Artifact, index: int, spec: RobotSpec) -> Recording:
    """Add the animal's skeleton to the recording of a retargeted clip.

    Args:
        recording: The whole clip.
        artifact: Motions that `retarget` wrote.
        index: Which of its clips it is.
        spec: Their robot.

    Returns:
        The same recording where the mocap is gone, changed, or was never there.
    """
    try:
        metrics, parent = artifact.metadata["metrics"]["clips"][index], artifact.parents[index]
        path = parent.locate(artifact.path)
        if hash_file(path) != parent.sha256:
            return recording
        mocap = Reading(**metrics["reading"]).of(path)
        radius = spec.foot_radius()
        skeleton = skeleton_in_size(mocap, metrics["paws"], float(metrics["scale"]), radius)
    except (KeyError, IndexError, TypeError, OSError, DatasetError, StageError):
        return recording  # the clip is what is played; its animal is an extra
    if len(skeleton) != recording.frames:
        return recording
    bones = tuple((parent, k) for k, parent in enumerate(mocap.parents) if parent >= 0)
    return replace(recording, skeleton=skeleton, bones=bones)


def skeleton_in_size(
    mocap: Mocap, paws: Sequence[str], scale: float, foot_radius: float
) -> np.ndarray:
    """Points (T, K, 3) of the animal, scaled, its standing paws at the height of the foot spheres.

    Args:
        mocap: The animal.
        paws: Its nodes that touch the ground.
        scale: Of the robot's motion relative to the animal's.
        foot_radius: m.

    Raises:
        DatasetError: The skeleton lacks a paw.
    """
    ground = float(stance_heights(mocap.keypoints(paws), ContactRule()).mean())
    return scale * (mocap.positions - [0.0, 0.0, ground]) + [0.0, 0.0, foot_radius]
