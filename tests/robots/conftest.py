import shutil
from pathlib import Path

import pytest

from lacoloco.robots.registry import load_robot, robot_names


@pytest.fixture(params=robot_names())
def robot(request):
    return load_robot(request.param)


@pytest.fixture
def solo12():
    return load_robot("solo12")


@pytest.fixture
def h1():
    return load_robot("h1")


@pytest.fixture
def robot_folder(solo12, tmp_path):
    """A copy of the folder of Solo12, to be edited."""
    return Path(shutil.copytree(solo12.folder, tmp_path / "solo12"))
