"""Fixtures that more than one room uses; everything else stands beside its tests."""

import os
import re

# Tiny tensors on several threads cost a hundred times what one thread takes when the cores are
# shared.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import shutil  # noqa: E402
import tempfile  # noqa: E402
from contextlib import contextmanager  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402
import pytest  # noqa: E402

from lacoloco.datasets import rotations  # noqa: E402
from lacoloco.datasets.clip import Clip  # noqa: E402

CHECKOUT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def shared():
    """The folder of recorded mocap and papers beside the checkout; its licences keep it out."""
    folder = CHECKOUT / "../shared"
    if not (folder / "data" / "mocap").is_dir():
        pytest.skip("needs the recorded mocap of ../shared, which may not be redistributed")
    return folder


@pytest.fixture(autouse=True)
def _runs_in_a_temporary_folder(tmp_path, monkeypatch):
    """No test writes into the runs of the person who starts it."""
    monkeypatch.setenv("LACOLOCO_RUNS", str(tmp_path / "runs"))


@pytest.fixture
def read_only_folder():
    """A folder in which the process may read but not write, also when it is the superuser."""
    folder = Path(tempfile.mkdtemp(prefix="lacoloco-read-only-"))
    folder.chmod(0o555)
    superuser = os.geteuid() == 0
    if superuser:
        os.seteuid(65534)
    try:
        yield folder
    finally:
        if superuser:
            os.seteuid(0)
        folder.chmod(0o755)
        shutil.rmtree(folder)


@pytest.fixture
def full_disk():
    """A context in which the process may write no file beyond 1 KiB: the operating system then
    refuses.

    Only for the writing itself: pytest's own output may be going to a longer file.
    """
    import resource

    @contextmanager
    def full():
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1024, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

    return full


@pytest.fixture
def make_clip():
    """Factory of clips with a known state: it circles at constant speed while joints oscillate.

    The base moves on a circle of radius 1 m at `speed` m/s, heading along it; joint j is
    sin(t + j). So v = (speed, 0, 0) and w = (0, 0, speed) in the base frame.
    """

    def factory(name="circle", frames=60, fps=50.0, joints=3, speed=0.5, **options):
        time = np.arange(frames) / fps
        angle = speed * time
        root_pos = np.stack([np.sin(angle), 1 - np.cos(angle), 0.3 + 0 * angle], axis=1)
        phase = time[:, None] + np.arange(joints)
        names = tuple(f"joint_{index}" for index in range(joints))
        root_quat = rotations.from_yaw(angle)
        return Clip.from_poses(name, fps, names, root_pos, root_quat, np.sin(phase), **options)

    return factory


NAMES = {
    # regular expressions, for MJCF and robot.toml alike
    "solo12": {
        r"(?<!\w)([FH?])L_": r"\1[l]_",
        r"(?<!\w)([FH?])R_": r"\1[r]_",
        r"(?<!\w)F(\?|\[.\])_": r"p\1_",
        r"(?<!\w)H(\?|\[.\])_": r"q\1_",
        r"\[(.)\]_": r"\1_",
        r"HAA": "spread",
        r"HFE": "swing",
        r"KFE": "bend",
        r"FOOT": "toe",
        r"UPPER_LEG": "femur",
        r"LOWER_LEG": "tibia",
        r"SHOULDER": "scapula",
        r"base_link": "trunk",
    },
    "h1": {
        r"\bleft_": "port_",
        r"\bright_": "star_",
        r"\bpelvis\b": "trunk",
        r"\btorso": "spine",
        r"_link\b": "_part",
        r"_FOOT\b": "_pad",
        r"_hip_": "_thigh_",
        r"_knee(?!s)": "_shin",
        r"_ankle": "_sole",
        r"_shoulder_": "_arm_",
        r"_elbow": "_forearm",
    },
}


@pytest.fixture(scope="session")
def renamed_robot():
    """Writer of a robot's folder that shares no name with the bundled one it was copied from."""
    from lacoloco.robots.registry import load_robot

    def write(parent, name="rover", original="solo12"):
        folder = parent / name
        folder.mkdir(parents=True)
        for file, text in load_robot(original).files().items():
            for pattern, word in {**NAMES[original], rf"\b{original}\b": name}.items():
                text = re.sub(pattern, word, text)
            (folder / re.sub(rf"\b{original}\b", name, file)).write_text(text)
        return folder

    return write
