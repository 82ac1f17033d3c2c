"""`.npz` of mjlab and BeyondMimic, both ways.

Sources: BeyondMimic `scripts/csv_to_npz.py` and `tasks/tracking/mdp/commands.py` of
HybridRobotics/whole_body_tracking (commit cd65172), mjlab `src/mjlab/scripts/csv_to_npz.py` and
`src/mjlab/tasks/tracking/mdp/commands.py` (0eda4e7). `fps` (1,), `joint_pos` and `joint_vel`
(T, J), and per body `body_pos_w`, `body_quat_w` (w, x, y, z), `body_lin_vel_w` and
`body_ang_vel_w` (T, B, ...), all of the world; body 0 is the root. Joints are in the order of the
simulator: that of the MJCF in mjlab, breadth first in Isaac Lab, which wrote BeyondMimic's. The
file does not say which. `joint_names` and `body_names`, which lacoloco writes too, are read where
they are there.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from lacoloco.datasets.errors import DatasetError, storage_errors
from lacoloco.datasets.foreign.motion import ForeignMotion, numbers, rate

MOST_BYTES = 4 << 30
BODIES = ("body_pos_w", "body_quat_w")


def read_npz(path: Path) -> ForeignMotion:
    """The motion of a `.npz`; arrays of objects, which are pickles, are refused.

    Raises:
        DatasetError: It is no such file, or lacks an array.
    """
    try:
        with storage_errors(path, "read"), zipfile.ZipFile(path) as packed:
            if sum(entry.file_size for entry in packed.infolist()) > MOST_BYTES:
                raise DatasetError(f"{path}: unpacks to more than any motion (4 GiB)")
        with np.load(path, allow_pickle=False) as stored:
            wanted = ("fps", "joint_pos", *BODIES)
            missing = [name for name in wanted if name not in stored.files and name != "fps"]
            if missing:
                raise DatasetError(
                    f"{path}: has no {', '.join(missing)}; motions of mjlab and BeyondMimic have"
                )
            found = {name: stored[name] for name in wanted if name in stored.files}
            names = _texts(stored["joint_names"]) if "joint_names" in stored.files else None
    except DatasetError:
        raise
    except Exception as error:  # whatever foreign bytes lead to, the file is to blame
        raise DatasetError(f"{path}: is no .npz of numbers, or damaged") from error
    places, turns = (numbers(found[name], name, str(path)) for name in BODIES)
    if places.ndim != 3 or turns.ndim != 3 or not places.shape[1] or not turns.shape[1]:
        raise DatasetError(f"{path}: {' and '.join(BODIES)} are not of frames and bodies")
    return ForeignMotion(
        path.stem,
        "npz of mjlab or BeyondMimic",
        places[:, 0],
        turns[:, 0],
        "wxyz",
        numbers(found["joint_pos"], "joint_pos", str(path)),
        names,
        None,
        rate(found["fps"], str(path)) if "fps" in found else None,
    )


def _texts(names: np.ndarray) -> tuple[str, ...] | None:
    return tuple(map(str, names.tolist())) if names.dtype.kind == "U" and names.ndim == 1 else None


def npz_bytes(arrays: Mapping[str, np.ndarray]) -> bytes:
    """The bytes of a `.npz`, the same for the same arrays."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as packed:
        for name, array in arrays.items():
            with packed.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, np.asarray(array), allow_pickle=False)
    return stream.getvalue()
