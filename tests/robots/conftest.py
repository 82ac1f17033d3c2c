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
