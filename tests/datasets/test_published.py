"""What comes with lacoloco: by name, by content, and in the lineage of what was made of it."""

import shutil

import numpy as np
import pytest

from lacoloco.datasets import published
from lacoloco.datasets.artifact import read_header, write_artifact
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.hashing import hash_file
from lacoloco.datasets.lineage import lineage
from lacoloco.datasets.publishing import MOST_BYTES, total_bytes
from lacoloco.datasets.store import RunStore


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Another place of the published artifacts."""
    folder = tmp_path / "published"
    folder.mkdir()
    monkeypatch.setattr(published, "FOLDER", folder)
    return folder


@pytest.fixture
def write(tmp_path):
    def factory(path, parents=()):
        values = {"metadata": {}, "config": {}, "seed": 0, "robot": None, "parents": parents}
        return write_artifact(path, "lacoloco/motions", {"a": np.arange(3.0)}, **values)

    return factory


def test_names_and_files_are_found(folder, write, tmp_path):
    made = write(folder / "solo12-dog.h5")
    elsewhere = write(tmp_path / "mine.h5")
    assert published.names() == ("solo12-dog",)
    assert published.find("solo12-dog") == made
    assert published.find("solo12-cat") is None
    assert published.resolve("solo12-dog") == made
    assert published.resolve(elsewhere) == elsewhere
    with pytest.raises(DatasetError, match=r"solo12-cat.*solo12-dog"):
        published.resolve("solo12-cat")


def test_a_folder_of_that_name_hides_nothing(folder, write, tmp_path, monkeypatch):
    made = write(folder / "solo12-dog.h5")
    (tmp_path / "solo12-dog").mkdir()
    monkeypatch.chdir(tmp_path)
    assert published.resolve("solo12-dog") == made


def test_a_copy_is_found_by_its_bytes(folder, write, tmp_path):
    original = write(tmp_path / "original.h5")
    assert published.find_copy(hash_file(original)) is None
    shutil.copy(original, folder / "copy.h5")
    assert published.find_copy(hash_file(original)) == folder / "copy.h5"


def test_what_is_made_of_something_published_names_it_without_a_place(folder, write):
    """So that the lineage holds on every machine."""
    parent = write(folder / "solo12-experts.h5")
    directory = RunStore().begin("run", "generate")
    write(directory.file("artifact.h5"), [parent])
    made = directory.complete()
    assert read_header(made).parents[0].path == "published:solo12-experts.h5"
    assert [(a.path, a.state) for a in lineage(made)[1:]] == [(parent, "ok")]


def test_an_ancestor_left_behind_is_found_where_it_is_published(folder, write, tmp_path):
    first = write(tmp_path / "first.h5")
    second = write(tmp_path / "second.h5", [first])
    shutil.copy(first, folder / "first.h5")
    first.unlink()
    assert [(a.path, a.state) for a in lineage(second)[1:]] == [(folder / "first.h5", "ok")]


def test_all_that_comes_with_lacoloco_is_small_enough():
    assert total_bytes() < MOST_BYTES == 15_000_000
