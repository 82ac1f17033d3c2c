from pathlib import Path

import pytest

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.mocap.sources import clip_names, find_recordings


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "more").mkdir()
    for name in ("b.bvh", "a.BVH", "notes.txt", "more/c.bvh"):
        (tmp_path / name).touch()
    return tmp_path


def names(paths):
    return [path.name for path in paths]


def test_folders_give_the_recordings_below_them(folder):
    assert names(find_recordings([folder])) == ["a.BVH", "b.bvh", "c.bvh"]


def test_patterns_files_and_repetitions(folder):
    found = find_recordings([f"{folder}/*.bvh", folder / "b.bvh", f"{folder}/**/c.bvh"])
    assert names(found) == ["b.bvh", "c.bvh"]


def test_a_file_that_is_missing_is_left_for_its_reader(tmp_path):
    assert find_recordings([tmp_path / "gone.bvh"]) == [tmp_path / "gone.bvh"]


def test_a_name_with_brackets_that_exists_is_no_pattern(tmp_path):
    path = tmp_path / "dog[1].bvh"
    path.touch()
    assert find_recordings([path]) == [path]


def test_one_file_by_two_ways_is_one_recording(folder):
    (folder / "link.bvh").symlink_to(folder / "b.bvh")
    (folder / "again").symlink_to(folder)
    found = find_recordings([folder / "b.bvh", folder / "again/b.bvh", folder / "link.bvh"])
    assert names(found) == ["b.bvh", "link.bvh"], "a link of another name may be meant"


def test_files_whose_endings_differ_have_names_of_their_own():
    """Else two clips would share a name, and a picture."""
    paths = [Path("d/walk.bvh"), Path("d/walk.BVH"), Path("d/run.bvh")]
    assert clip_names(paths) == ["walk.bvh", "walk.BVH", "run"]
    assert clip_names([*paths, Path("e/walk.bvh")]) == ["walk.bvh", "walk.BVH", "run", "walk"]


def test_nothing_found_is_said(tmp_path):
    with pytest.raises(StageError, match=r"no \.bvh file"):
        find_recordings([tmp_path])
    with pytest.raises(StageError, match="matches no file"):
        find_recordings([f"{tmp_path}/*.bvh"])


def test_equal_stems_are_told_apart_by_their_folders():
    paths = [Path("x/one/dog.bvh"), Path("x/two/dog.bvh"), Path("x/two/cat.bvh")]
    assert clip_names(paths) == ["one/dog", "two/dog", "cat"]


@pytest.mark.parametrize(
    ("inputs", "expected"),
    [
        (("/s9/walk.bvh", "/s1/walk.bvh"), ["s9/walk", "s1/walk"]),
        (("../a/../s1/walk.bvh", "../s2/walk.bvh"), ["s1/walk", "s2/walk"]),
        (("/walk.bvh", "/s1/walk.bvh"), ["walk", "s1/walk"]),
    ],
)
def test_names_of_clips_never_lead_out_of_their_folder(inputs, expected):
    assert clip_names([Path(path) for path in inputs]) == expected
