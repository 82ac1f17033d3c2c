import os
import shutil
import socket
import subprocess
import sys

import numpy as np
import pytest
import torch

from lacoloco.datasets import rotations
from lacoloco.datasets.clip import Clip
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.robots.registry import load_robot, robot_names

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@pytest.fixture
def browser():
    """A headless Chromium of this machine."""
    playwright = pytest.importorskip("playwright.sync_api")
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip("needs a Chromium")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=found, args=list(FLAGS))
        try:
            yield chromium
        finally:
            chromium.close()


class Processes:
    """Scripts in several processes that find each other the way torchrun's do."""

    def start(self, script, count, *arguments):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = str(free.getsockname()[1])
        shared = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, "WORLD_SIZE": str(count)}
        command = [sys.executable, script, *arguments]
        return [
            subprocess.Popen(
                command, env={**os.environ, **shared, "RANK": rank, "LOCAL_RANK": rank}
            )
            for rank in map(str, range(count))
        ]

    def wait(self, running):
        return [process.wait(timeout=900) for process in running]

    def results(self, path, count):
        """What each process saved under the path and its number."""
        return [torch.load(f"{path}.{rank}", weights_only=False) for rank in range(count)]


@pytest.fixture
def processes():
    return Processes()


@pytest.fixture
def solo12():
    return load_robot("solo12")


@pytest.fixture
def h1():
    return load_robot("h1")


@pytest.fixture(params=robot_names())
def robot(request):
    return load_robot(request.param)


@pytest.fixture
def in_a_temporary_folder(tmp_path, monkeypatch):
    """Where MuJoCo may leave the log of the warnings that a test provokes."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def make_clips():
    """Factory of two clips in which a robot trots straight on while it turns.

    The base moves forward in its own frame at 0.4 m/s and turns at 0.5 rad/s, at the height at
    which it stands; every joint swings by 0.1 rad around its default.
    """

    def factory(spec, frames=60, fps=50.0):
        time = np.arange(frames) / fps
        clips = []
        for index, phase in enumerate((0.0, 1.0)):
            yaw = 0.5 * time + phase
            path = np.stack([np.sin(yaw) / 0.5, -np.cos(yaw) / 0.5], axis=1) * 0.4
            root_pos = np.column_stack([path, np.full(frames, spec.default_height())])
            swing = np.sin(8.0 * time[:, None] + phase + np.arange(spec.num_joints))
            joints = np.array(spec.default_joint_pos) + 0.1 * swing
            clips.append(
                Clip.from_poses(
                    f"clip_{index}",
                    fps,
                    spec.joint_names,
                    root_pos,
                    rotations.from_yaw(yaw),
                    joints,
                    skill="walk",
                )
            )
        return clips

    return factory


@pytest.fixture
def make_motions(make_clips):
    """Factory of a library of these clips."""
    return lambda *arguments, **options: MotionLibrary(make_clips(*arguments, **options))


@pytest.fixture
def motions(make_motions, solo12):
    return make_motions(solo12)


@pytest.fixture(autouse=True)
def _one_thread():
    """Small tensors gain nothing from more, and sums then come in one order."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def short_dog(tmp_path):
    """Factory of files with some frames of the bundled dog."""
    lines = DOG_BVH.read_text().splitlines()
    motion = lines.index("MOTION")

    def write(frames=slice(0, 60), name="short.bvh"):
        rows = lines[motion + 3 :][frames]
        text = [*lines[: motion + 1], f"Frames:\t{len(rows)}", lines[motion + 2], *rows]
        path = tmp_path / name
        path.write_text("\n".join(text) + "\n")
        return path

    return write
