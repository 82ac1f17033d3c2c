import pytest

from lacoloco.robots.errors import RobotError
from lacoloco.robots.registry import load_robot, robot_names


def test_every_name_loads_the_robot_of_that_name():
    assert robot_names() == ("solo12", "h1")
    assert [load_robot(name).name for name in robot_names()] == ["solo12", "h1"]


@pytest.mark.parametrize(("name", "near"), [("Solo-12", "'solo12'"), ("H1", "'h1'")])
def test_a_misspelt_name_gets_the_nearest(name, near):
    with pytest.raises(RobotError, match=f"solo12, h1; did you mean {near}"):
        load_robot(name)


def test_a_strange_name_gets_the_list():
    with pytest.raises(RobotError) as error:
        load_robot("zzz")
    assert str(error.value) == "unknown robot 'zzz': choose one of solo12, h1"
