"""Whatever is in a file, the answer is one line for the person who gave it."""

import json
import pickle
import random

import numpy as np
import pytest

from lacoloco.datasets.clip import Clip
from lacoloco.pipelines.foreign_motions.config import ImportConfig
from lacoloco.pipelines.foreign_motions.convert import convert
from lacoloco.pipelines.foreign_motions.writing import encoded
from lacoloco.robots.registry import load_robot
from lacoloco_cli.failures import USER_MISTAKE, explain

INPUTS = 60
NASTY = (b"nan", b"1e999", b"-1", b"", b"{", b"]", b"\0", b"\xff", b"9" * 400, b",", b"\n", b"0")


@pytest.fixture(scope="module")
def spec():
    return load_robot("solo12")


@pytest.fixture(scope="module")
def sound(spec):
    """Ending -> files that can be imported as they are."""
    joints = np.tile(spec.default_joint_pos, (5, 1))
    pos = np.tile([0.0, 0.0, spec.default_height()], (5, 1))
    wxyz, xyzw = np.tile([1.0, 0, 0, 0], (5, 1)), np.tile([0, 0, 0, 1.0], (5, 1))
    clip = Clip.from_poses("one", 50.0, spec.joint_names, pos, wxyz, joints)
    gmr = {"fps": 50, "root_pos": pos, "root_rot": xyzw, "dof_pos": joints}
    mimickit = {"fps": 50, "frames": np.hstack([pos, 0 * pos, joints]).tolist()}
    frames = {"FrameDuration": 0.02, "Frames": np.hstack([pos, xyzw, joints]).tolist()}
    return {
        ".npz": [encoded(spec, clip, "npz")],
        ".csv": [encoded(spec, clip, "csv")],
        ".txt": [json.dumps(frames).encode()],
        ".pkl": [pickle.dumps(one, k) for one in (gmr, mimickit) for k in (0, 2, 4)],
    }


def altered(content, chance):
    content = bytearray(content)
    for _ in range(chance.randint(1, 3)):
        start = chance.randrange(len(content) + 1)
        stop = start + chance.choice((0, 1, 2, 20))
        kind = chance.randrange(3)
        if kind == 0 and content[start : start + 1]:
            content[start] ^= 1 << chance.randrange(8)
        elif kind == 1:
            content[start:stop] = b""
        else:
            content[start:stop] = chance.choice(NASTY)
    return bytes(content)


@pytest.mark.parametrize("ending", [".npz", ".csv", ".txt", ".pkl"])
def test_altered_files_are_read_or_refused_in_one_line(spec, sound, tmp_path, ending):
    file = tmp_path / f"altered{ending}"
    for content in sound[ending]:
        file.write_bytes(content)
        assert convert(spec, file, ImportConfig(), "sound").clip.frames == 5
    refused = 0
    for index in range(INPUTS):
        chance = random.Random(f"{ending} {index}")
        file.write_bytes(altered(chance.choice(sound[ending]), chance))
        try:
            convert(spec, file, ImportConfig(), "altered")
        except Exception as error:
            line, code = explain(error)
            assert code == USER_MISTAKE and "\n" not in line, (index, line)
            refused += 1
    assert refused > 5
