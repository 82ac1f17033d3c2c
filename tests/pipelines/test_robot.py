"""An artifact finds its robot again, also where the robot's folder is gone."""

import shutil

import pytest

from lacoloco.datasets.artifact import read_header, write_artifact
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.robot import belongs_to, record_of, robot_of, robot_of_all
from lacoloco.robots.errors import RobotError
from lacoloco.robots.registry import load_robot


@pytest.fixture
def written(tmp_path):
    """Factory of headers of artifacts of a robot, or of what a record says of one."""

    def write(robot, name="artifact"):
        path = tmp_path / f"{name}.h5"
        options = {"metadata": {}, "config": {}, "seed": 0, "robot": robot}
        return read_header(write_artifact(path, "lacoloco/motions", {}, **options))

    return write


@pytest.fixture
def rover(renamed_robot, tmp_path):
    return renamed_robot(tmp_path / "robots")


def edit(folder, old, new, file="robot.toml"):
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new))


def test_a_bundled_robot_is_taken_as_it_is(solo12, written):
    said = []
    header = written(record_of(solo12))
    assert header.robot_folder == "", "where lacoloco is installed is nobody's business"
    assert robot_of(header, said.append).folder == solo12.folder
    assert not said


def test_an_artifact_of_before_finds_its_robot_by_name(solo12, written):
    header = written((solo12.name, solo12.model_hash()))
    assert robot_of(header).files() == solo12.files()
    assert belongs_to(header, solo12)


def test_its_own_folder_comes_first(rover, written):
    spec = load_robot(rover)
    assert robot_of(written(record_of(spec))).folder == rover


def test_a_folder_that_moved_is_found_by_name(rover, written, tmp_path, monkeypatch):
    said = []
    header = written(record_of(load_robot(rover)))
    (tmp_path / "elsewhere").mkdir()
    moved = rover.rename(tmp_path / "elsewhere" / "rover")
    monkeypatch.setenv("LACOLOCO_ROBOTS", str(tmp_path / "elsewhere"))
    assert robot_of(header, said.append).folder == moved
    assert not said


def test_the_artifacts_texts_are_taken_where_the_folder_is_gone(rover, written):
    said = []
    spec = load_robot(rover)
    header = written(record_of(spec))
    shutil.rmtree(rover)
    found = robot_of(header, said.append)
    assert (found.files(), found.joint_names) == (spec.files(), spec.joint_names)
    assert found.default_height() == spec.default_height()
    (line,) = said
    assert f"{rover} is not there" in line and "artifact.h5" in line


def test_the_artifacts_texts_are_taken_where_the_folder_has_changed(rover, written):
    said = []
    header = written(record_of(load_robot(rover)))
    edit(rover, "stiffness = 4.0", "stiffness = 5.0")
    assert robot_of(header, said.append).stiffness[0] == 4.0
    assert "has changed since" in said[0]
    edit(rover, "stiffness = 5.0", "stiffness = much")  # no longer a robot at all
    assert robot_of(header).stiffness[0] == 4.0


def test_a_carried_table_of_another_form_gives_way_to_the_same_model(solo12, written):
    carried = {**solo12.files(), "robot.toml": 'name = "solo12"\nhorn = true\n'}
    record = record_of(solo12)._replace(files=carried)
    assert robot_of(written(record, "older")).files() == solo12.files()
    with pytest.raises(RobotError, match="the robot that it carries cannot be used") as caught:
        robot_of(written(record._replace(model_hash="0"), "other"))
    assert "\n" not in str(caught.value)


def test_an_artifact_without_a_robot_is_refused(written):
    with pytest.raises(RobotError, match="belongs to no robot"):
        robot_of(written(None))


def test_versions_of_one_robot_are_not_mixed(rover, written, solo12):
    before = written(record_of(load_robot(rover)), "before")
    edit(rover, "stiffness = 4.0", "stiffness = 5.0")
    after = written(record_of(load_robot(rover)), "after")
    with pytest.raises(StageError, match="different versions of robot 'rover'") as caught:
        robot_of_all([before.path, after.path])
    assert "\n" not in str(caught.value)
    with pytest.raises(StageError, match="exactly one robot.*rover, solo12"):
        robot_of_all([before.path, written(record_of(solo12), "solo").path])
    with pytest.raises(StageError, match="found: none"):
        robot_of_all([])
    assert robot_of_all([after.path]).stiffness[0] == 5.0
    assert not belongs_to(before, load_robot(rover))


def test_a_table_that_nothing_reads_makes_no_other_robot(rover, written):
    before = written(record_of(load_robot(rover)))
    edit(rover, "[terminations]", "[hindsight]\nstride = 0.1\n\n[terminations]")
    assert belongs_to(before, load_robot(rover))
