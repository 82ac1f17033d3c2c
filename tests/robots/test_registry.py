import os
import shutil

import pytest

from lacoloco.robots.errors import RobotError
from lacoloco.robots.registry import load_robot, robot_folders, robot_names


@pytest.fixture(autouse=True)
def no_robots_of_ones_own(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("LACOLOCO_ROBOTS", raising=False)


def rename(folder, name):
    """Call the Solo12 in ``folder`` otherwise; the folder takes the name, too."""
    toml = folder / "robot.toml"
    toml.write_text(toml.read_text().replace('name = "solo12"', f'name = "{name}"'))
    (folder / "solo12.xml").rename(folder / f"{name}.xml")
    return folder.rename(folder.with_name(name))


def test_every_name_loads_the_robot_of_that_name():
    assert robot_names() == ("solo12", "h1", "go2")
    assert [load_robot(name).name for name in robot_names()] == ["solo12", "h1", "go2"]


def test_a_robot_is_found_by_the_path_of_its_folder_or_toml(robot_folder, solo12):
    for path in (robot_folder, str(robot_folder), f"{robot_folder}/", robot_folder / "robot.toml"):
        spec = load_robot(path)
        assert (spec.name, spec.folder) == ("solo12", robot_folder)
        assert spec.files() == solo12.files()


def test_a_folder_in_the_current_one_is_a_path(robot_folder, monkeypatch):
    rename(robot_folder, "dog")
    monkeypatch.chdir(robot_folder.parent)
    assert load_robot("dog").name == "dog"


def test_robots_of_ones_own_extend_the_list(robot_folder, monkeypatch, tmp_path):
    dog = rename(robot_folder, "dog")
    home = tmp_path / "home/.config/lacoloco/robots"
    home.mkdir(parents=True)
    cat = rename(shutil.copytree(load_robot("solo12").folder, home / "solo12"), "cat")
    shutil.copytree(load_robot("solo12").folder, home / "solo12")  # the bundled one goes first
    monkeypatch.setenv("LACOLOCO_ROBOTS", os.pathsep.join([str(tmp_path), ""]))
    assert robot_names() == ("solo12", "h1", "go2", "dog", "cat")
    assert load_robot("dog").folder == dog and load_robot("cat").folder == cat
    assert robot_folders()["solo12"] != home / "solo12"


def test_a_folder_by_another_name_than_its_robot_is_refused(robot_folder, monkeypatch, tmp_path):
    robot_folder.rename(tmp_path / "dog")
    monkeypatch.setenv("LACOLOCO_ROBOTS", str(tmp_path))
    with pytest.raises(RobotError, match="robot.toml: name: expected 'dog'.*found 'solo12'"):
        load_robot("dog")


def test_a_folder_of_robots_that_does_not_exist_is_refused(monkeypatch):
    monkeypatch.setenv("LACOLOCO_ROBOTS", "/no/where")
    with pytest.raises(RobotError, match="LACOLOCO_ROBOTS: no such folder '/no/where'"):
        load_robot("solo12")


@pytest.mark.parametrize(("name", "near"), [("Solo-12", "'solo12'"), ("H1", "'h1'")])
def test_a_misspelt_name_gets_the_nearest(name, near):
    with pytest.raises(RobotError, match=f"solo12, h1, go2; did you mean {near}"):
        load_robot(name)


def test_a_strange_name_gets_the_list():
    with pytest.raises(RobotError) as error:
        load_robot("zzz")
    assert str(error.value) == (
        "unknown robot 'zzz': choose one of solo12, h1, go2, or give the path of a folder with "
        "robot.toml"
    )


@pytest.mark.parametrize("path", ["./nothing", "nothing/robot.toml", "~/nothing"])
def test_a_path_without_a_robot_says_what_a_robot_is(path):
    with pytest.raises(RobotError, match="nothing: no robot there: a robot is a folder with"):
        load_robot(path)
