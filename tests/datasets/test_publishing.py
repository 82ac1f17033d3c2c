"""Publishing: an exact copy, its lineage beside it, and what is refused."""

import json

import numpy as np
import pytest

from lacoloco.datasets import provenance, published, publishing
from lacoloco.datasets.artifact import read_artifact, write_artifact
from lacoloco.datasets.errors import ArtifactError, DatasetError
from lacoloco.datasets.hashing import hash_file
from lacoloco.datasets.publishing import publish, recorded
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.datasets.store import RunStore

COMMIT = "a" * 40


@pytest.fixture
def folder(tmp_path, monkeypatch):
    folder = tmp_path / "published"
    folder.mkdir()
    monkeypatch.setattr(published, "FOLDER", folder)
    return folder


@pytest.fixture
def add(monkeypatch):
    """Complete one version of a stage, made by committed code unless said otherwise."""

    def factory(stage, parents=(), commit=COMMIT, options=""):
        monkeypatch.setattr(provenance, "git_commit", lambda: commit)
        directory = RunStore().begin("run", stage)
        write_artifact(
            directory.file("artifact.h5"),
            "lacoloco/motions",
            {"a": np.arange(4.0)},
            metadata={},
            config={"rate": 0.5},
            seed=3,
            robot=("solo12", "abc"),
            parents=parents,
            command=f"lacoloco {stage}{options}",
        )
        monkeypatch.setattr(provenance, "git_commit", lambda: COMMIT)
        return directory.complete()

    return factory


def test_the_copy_is_exact_and_its_lineage_is_recorded(folder, add):
    clips = add("retarget", [DOG_BVH])
    low = add("train-low", [clips])
    copy = publish(low, "solo12-dog-low")
    assert copy == folder / "solo12-dog-low.h5"
    assert copy.read_bytes() == low.read_bytes()
    record = recorded("solo12-dog-low")
    assert record["sha256"] == hash_file(low)
    rows = record["lineage"]
    assert [(row["depth"], row["file"]) for row in rows] == [
        (0, "run/train-low/0001"),
        (1, "run/retarget/0001"),
        (2, DOG_BVH.name),
    ]
    assert rows[0]["content_hash"] == read_artifact(low).content_hash
    assert rows[0]["parents"] == [rows[1]["sha256"]] == [hash_file(clips)]
    assert rows[1]["git_commit"] == COMMIT
    assert (rows[1]["command"], rows[1]["seed"]) == ("lacoloco retarget", 3)


def test_the_record_names_no_place_on_this_machine(folder, add, tmp_path):
    publish(add("train-low", [add("retarget", [DOG_BVH])]), "low")
    text = (folder / "low.json").read_text()
    assert str(tmp_path) not in text
    assert str(DOG_BVH.parent) not in text


def test_nothing_published_is_replaced(folder, add):
    first = publish(add("train-low"), "low").read_bytes()
    with pytest.raises(DatasetError, match="published already"):
        publish(add("train-low"), "low")
    assert (folder / "low.h5").read_bytes() == first


@pytest.mark.parametrize("name", ["", "Solo", "a b", "../a", "a-", "a.h5"])
def test_names_are_plain(folder, add, name):
    with pytest.raises(DatasetError, match="lower-case"):
        publish(add("train-low"), name)
    assert not list(folder.iterdir())


@pytest.mark.parametrize("commit", [COMMIT + "-dirty", ""])
def test_what_uncommitted_code_made_is_refused_also_far_back(folder, add, commit):
    dirty = add("generate", commit=commit)
    for artifact in (dirty, add("train-low", [dirty])):
        with pytest.raises(DatasetError, match="not committed"):
            publish(artifact, "low")


def test_what_was_not_committed_may_be_said_instead(folder, add):
    dirty = add("train-low", [add("generate", commit=COMMIT + "-dirty")])
    publish(dirty, "low", uncommitted="one reward, committed as abc1234")
    assert recorded("low")["uncommitted"] == "one reward, committed as abc1234"
    with pytest.raises(DatasetError, match="no checkout"):
        publish(add("generate", commit=""), "clips", uncommitted="all of it")


def test_nothing_is_said_to_have_been_uncommitted_that_was_not(folder, add):
    with pytest.raises(DatasetError, match="--uncommitted: .* leave it out"):
        publish(add("train-low", [add("generate")]), "low", uncommitted="one reward")
    assert not list(folder.iterdir())


def test_what_was_published_before_is_not_judged_again(folder, add):
    publish(add("experts"), "experts")
    other = add("generate", commit=COMMIT + "-dirty")
    (folder / "old.h5").write_bytes(other.read_bytes())
    publish(add("train-low", [folder / "old.h5"]), "low")
    assert [row["file"] for row in recorded("low")["lineage"]] == ["run/train-low/0001", "old.h5"]


@pytest.mark.parametrize("option", [" --robot /somewhere/rover", " --robot=/somewhere/rover"])
def test_a_command_that_names_a_place_on_the_machine_is_refused_also_far_back(folder, add, option):
    experts = add("generate", options=option)
    for artifact in (experts, add("train-low", [experts])):
        with pytest.raises(DatasetError, match="names a place on this machine"):
            publish(artifact, "low")
    assert publish(add("generate", options=" --robot robots/rover"), "clips").is_file()


def test_sources_of_others_are_refused(folder, add, tmp_path):
    recorded_mocap = tmp_path / "dog.bvh"
    recorded_mocap.write_text("HIERARCHY")
    with pytest.raises(DatasetError, match=r"dog.bvh.*lacoloco's own samples"):
        publish(add("train-low", [add("retarget", [recorded_mocap])]), "low")


def test_a_lineage_with_gaps_is_refused(folder, add):
    clips = add("retarget", [DOG_BVH])
    low = add("train-low", [clips])
    clips.unlink()
    with pytest.raises(DatasetError, match="is missing"):
        publish(low, "low")


def test_a_parent_elsewhere_on_this_machine_is_refused(folder, add, tmp_path):
    clips = add("retarget", [DOG_BVH])
    other = tmp_path / "other.h5"
    other.write_bytes(clips.read_bytes())
    with pytest.raises(DatasetError, match="place on this machine"):
        publish(add("train-low", [other]), "low")


def test_all_together_stay_small(folder, add, monkeypatch):
    artifact = add("train-low")
    monkeypatch.setattr(publishing, "MOST_BYTES", artifact.stat().st_size - 1)
    with pytest.raises(DatasetError, match="MB is the most"):
        publish(artifact, "low")
    assert not list(folder.iterdir())


def test_damaged_artifacts_and_installed_copies_publish_nothing(folder, add, monkeypatch):
    artifact = add("train-low")
    monkeypatch.setattr(provenance, "git_commit", lambda: "")
    with pytest.raises(DatasetError, match="checkout"):
        publish(artifact, "low")
    monkeypatch.setattr(provenance, "git_commit", lambda: COMMIT)
    artifact.write_bytes(artifact.read_bytes()[:-100])
    with pytest.raises(ArtifactError):
        publish(artifact, "low")
    assert not list(folder.iterdir())


def test_a_damaged_record_is_named(folder):
    assert recorded("low") is None
    (folder / "low.json").write_text("{")
    with pytest.raises(ArtifactError, match=r"low.json"):
        recorded("low")
    (folder / "low.json").write_text(json.dumps({"name": "low"}))
    assert recorded("low") == {"name": "low"}


def test_what_was_made_over_a_published_one_takes_its_recorded_lineage(folder, add):
    """The files that the published one was made of may be on another machine."""
    clips = add("retarget", [DOG_BVH])
    low = publish(add("train-low", [clips]), "low")
    clips.unlink()
    publish(add("train-high", [low]), "high")
    rows = recorded("high")["lineage"]
    assert [row["depth"] for row in rows[:3]] == [0, 1, 2]
    assert rows[1:] == [row | {"depth": row["depth"] + 1} for row in recorded("low")["lineage"]]
