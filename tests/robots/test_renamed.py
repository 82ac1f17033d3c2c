"""Nothing depends on what a robot, its joints and its bodies are called."""

import pytest

from lacoloco.robots.check import check_robot
from lacoloco.robots.errors import RobotError
from lacoloco.robots.registry import is_bundled, load_robot, robot_names, robot_origins


@pytest.mark.parametrize("original", ["solo12", "h1"])
def test_a_robot_with_other_names_passes_the_same_checks(renamed_robot, tmp_path, original):
    usual, other = load_robot(original), load_robot(renamed_robot(tmp_path, "rover", original))
    names = {*other.joint_names, *other.contact_bodies, *other.knee_frames, other.name}
    assert not names & {*usual.joint_names, *usual.contact_bodies, *usual.knee_frames, usual.name}
    assert not is_bundled(other) and is_bundled(usual)
    report, expected = check_robot(other), check_robot(usual)
    assert not report.failures()
    assert report.total_mass == expected.total_mass
    assert len(report.checks) == len(expected.checks)


def test_robots_of_ones_own_are_found_by_name_and_by_path(renamed_robot, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    renamed_robot(tmp_path / "robots", "rover")
    renamed_robot(tmp_path / "home" / ".config" / "lacoloco" / "robots", "walker", "h1")
    monkeypatch.setenv("LACOLOCO_ROBOTS", str(tmp_path / "robots"))
    assert robot_names() == ("solo12", "h1", "go2", "rover", "walker")
    assert list(robot_origins().values()) == [
        "lacoloco",
        "lacoloco",
        "lacoloco",
        "LACOLOCO_ROBOTS",
        "~/.config/lacoloco/robots",
    ]
    assert load_robot("rover").files() == load_robot(tmp_path / "robots" / "rover").files()
    assert load_robot("walker").num_joints == 19


def test_a_folder_with_the_name_of_another_robot_is_refused(renamed_robot, tmp_path, monkeypatch):
    impostor = renamed_robot(tmp_path, "h1")
    with pytest.raises(RobotError, match="'h1' is another robot.*a name of its own") as caught:
        load_robot(impostor)
    assert "\n" not in str(caught.value)
    copy = tmp_path / "copy"
    copy.mkdir()
    for file, text in load_robot("solo12").files().items():
        (copy / file).write_text(text)
    assert load_robot(copy).name == "solo12", "the same robot is no other one"
