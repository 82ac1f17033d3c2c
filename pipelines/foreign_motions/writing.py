"""Clips as other programs read them: `.npz` of mjlab and BeyondMimic, and CSV."""

from __future__ import annotations

import io

import numpy as np

from lacoloco.datasets.clip import Clip
from lacoloco.datasets.foreign.npz import npz_bytes
from lacoloco.datasets.foreign.tables import LAFAN_FPS, POSITION, QUAT
from lacoloco.pipelines.sim.body_states import body_states, body_velocities
from lacoloco.robots.spec import RobotSpec

FORMATS = {"npz": ".npz", "csv": ".csv", "lafan1": ".csv"}
"""Format -> ending of its files."""


def encoded(spec: RobotSpec, clip: Clip, form: str) -> bytes:
    """The file of a clip, in one of ``FORMATS``; lafan1 has 30 frames per second, whatever the
    clip has, since it does not say and readers know.
    """
    if form == "lafan1":
        clip = clip.resample(LAFAN_FPS)
    if form == "npz":
        return npz_bytes(npz_arrays(spec, clip))
    return csv_text(clip, header=form == "csv").encode()


def npz_arrays(spec: RobotSpec, clip: Clip) -> dict[str, np.ndarray]:
    """What mjlab and BeyondMimic read, by name, with joints in the order of the robot's MJCF;
    beside it `joint_names` and `body_names`, which say the order.

    Returns:
        `fps` (1,); `joint_pos`, `joint_vel` (T, J); of the B bodies, base first, `body_pos_w`,
        `body_lin_vel_w`, `body_ang_vel_w` (T, B, 3) and `body_quat_w` (T, B, 4) wxyz: of their
        origins, in the world, m, m/s and rad/s.
    """
    poses = (clip.root_pos, clip.root_quat, clip.joint_pos)
    velocities_b = (clip.root_lin_vel_b, clip.root_ang_vel_b, clip.joint_vel)
    states = body_states(spec, *poses)
    velocities = body_velocities(spec, np.hstack(poses), np.hstack(velocities_b))
    numbers = {
        "joint_pos": clip.joint_pos,
        "joint_vel": clip.joint_vel,
        "body_pos_w": states.pos,
        "body_quat_w": states.quat,
        "body_lin_vel_w": velocities.lin_vel,
        "body_ang_vel_w": velocities.ang_vel,
    }
    return {
        "fps": np.array([clip.fps]),
        **{name: values.astype(np.float32) for name, values in numbers.items()},
        "joint_names": np.array(clip.joint_names),
        "body_names": np.array(states.names),
    }


def csv_text(clip: Clip, *, header: bool) -> str:
    """A table of a clip, a line per frame.

    Args:
        clip: The clip.
        header: With it: a column of seconds, position, quaternion wxyz and joints by name. Without:
            position, quaternion xyzw and joints, as the retargeted LAFAN1 has them; the rate is not
            said there.
    """
    if header:
        names = ["time", *POSITION, *QUAT, *clip.joint_names]
        time = np.arange(clip.frames)[:, None] / clip.fps
        rows = np.hstack([time, clip.root_pos, clip.root_quat, clip.joint_pos])
    else:
        rows = np.hstack([clip.root_pos, clip.root_quat[:, [1, 2, 3, 0]], clip.joint_pos])
    stream = io.StringIO()
    if header:
        stream.write(",".join(names) + "\n")
    np.savetxt(stream, rows, fmt="%.9g", delimiter=",")
    return stream.getvalue()
