import json
import os
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest

from lacoloco.datasets import artifact as artifacts
from lacoloco.datasets.artifact import SCHEMAS, read_artifact, read_header, write_artifact
from lacoloco.datasets.atomic_write import write_file
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.robot_record import RobotRecord

ARRAYS = {
    "weights/layer 0": np.arange(6, dtype=np.float32).reshape(2, 3),
    "doubles": np.array([0.1, np.nan, -0.0, np.inf]),
    "bytes": np.arange(256, dtype=np.uint8),
    "big": np.array([2**62, -(2**62)], dtype=np.int64),
    "mask": np.array([[True], [False]]),
    "scalar": np.array(3.5),
    "empty": np.zeros((0, 4), dtype=np.float32),
    "strided": np.arange(12.0).reshape(3, 4).T,
}


@pytest.fixture
def write(tmp_path):
    def factory(name="artifact.h5", schema="lacoloco/motions", arrays=ARRAYS, **options):
        defaults = {"metadata": {"joint_names": ["a", "b"]}, "config": {"rate": 0.1}, "seed": 7}
        defaults["robot"] = ("solo12", "abc123")
        return write_artifact(tmp_path / name, schema, arrays, **{**defaults, **options})

    return factory


def one_line(caught, *words):
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert str(word) in message


def test_round_trip_keeps_every_bit_and_type(write):
    result = read_artifact(write(command="lacoloco retarget dog.bvh"), "lacoloco/motions")
    assert set(result.arrays) == set(ARRAYS)
    for name, array in ARRAYS.items():
        restored = result.arrays[name]
        assert (restored.dtype, restored.shape) == (array.dtype, array.shape)
        assert restored.tobytes() == array.tobytes()
    assert result.metadata == {"joint_names": ["a", "b"]}
    assert result.config == {"rate": 0.1}
    assert (result.seed, result.robot, result.robot_hash) == (7, "solo12", "abc123")
    assert result.command == "lacoloco retarget dog.bvh"
    assert result.schema_version == SCHEMAS["lacoloco/motions"]
    assert len(result.content_hash) == 64


def test_seed_and_robot_may_be_absent_and_header_reads_alone(write):
    header = read_header(write(seed=None, robot=None))
    assert (header.seed, header.robot, header.command) == (None, "", "")


def test_the_texts_of_the_robot_travel_with_the_artifact(write):
    files = {"robot.toml": 'name = "solo12"\n', "solo12.xml": "<mujoco/>"}
    record = RobotRecord("solo12", "abc123", files, "/somewhere/solo12")
    path = write(robot=record)
    for header in (read_header(path), read_artifact(path, robot="solo12")):
        assert header.robot_record == record
        assert (header.robot, header.robot_hash) == ("solo12", "abc123")
    with h5py.File(path, "r+") as file:
        file.attrs["robot_files"] = np.bytes_(b'{"robot.toml": "name = 1", "solo12.xml": ""}')
    with pytest.raises(ArtifactError, match="does not match its hash"):
        read_artifact(path)
    with h5py.File(path, "r+") as file:
        file.attrs["robot_files"] = np.bytes_(b'{"robot.toml": 5}')
    with pytest.raises(ArtifactError, match="header is cut short or damaged"):
        read_header(path)


def test_records_of_a_robot_agree_as_far_as_both_say():
    before = RobotRecord("solo12", "abc")
    now = RobotRecord("solo12", "abc", {"robot.toml": "a"}, "/here")
    assert before.agrees_with(now) and now.agrees_with(before)
    assert now.agrees_with(now._replace(folder="/there"))
    assert not now.agrees_with(now._replace(files={"robot.toml": "b"}))
    assert not now.agrees_with(now._replace(model_hash="def"))
    assert not before.agrees_with(before._replace(name="solo13"))
    says = [
        now._replace(files={"robot.toml": text})
        for text in ("mass = 1", "mass = 1 # kg", "mass = 1\n[retargeting]\nknees = []", "mass = 2")
    ]
    assert says[0].agrees_with(says[1]), "a comment changes no robot"
    assert says[0].agrees_with(says[2]), "nor does how recordings become its motions"
    assert not says[0].agrees_with(says[3])
    assert before.digest == "abc"
    assert now.digest == now._replace(folder="/there").digest
    assert now.digest != now._replace(files={"robot.toml": "b"}).digest


def test_large_metadata_survives(write):
    names = [f"clip {index:06d}" for index in range(20_000)]
    assert read_artifact(write(metadata={"names": names})).metadata["names"] == names


def test_data_hash_depends_on_the_data_alone(write):
    first = read_artifact(write("a.h5", config={"x": 1}))
    second = read_artifact(write("b.h5", config={"x": 2}))
    other = read_artifact(write("c.h5", arrays={**ARRAYS, "scalar": np.array(3.6)}))
    assert first.data_hash == second.data_hash != other.data_hash
    assert first.content_hash != second.content_hash


def test_never_overwrites_unless_it_replaces_a_checkpoint(write):
    path = write()
    before = path.read_bytes()
    with pytest.raises(ArtifactError, match="never overwritten") as caught:
        write()
    one_line(caught, path)
    assert path.read_bytes() == before
    write(seed=8, replace=True)
    assert read_artifact(path).seed == 8


def test_a_failing_write_leaves_no_rubbish(write, tmp_path, full_disk):
    with full_disk(), pytest.raises(ArtifactError, match="cannot write: file too large") as caught:
        write()
    one_line(caught, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_read_only_folder(write, read_only_folder):
    with pytest.raises(ArtifactError, match="cannot write: permission denied") as caught:
        write_artifact(
            read_only_folder / "a.h5",
            "lacoloco/motions",
            {},
            metadata={},
            config={},
            seed=None,
            robot=None,
        )
    one_line(caught, read_only_folder)


def test_a_killed_writer_leaves_no_half_file(tmp_path):
    """The writer is killed while it writes over and over; what is there always reads."""
    path = tmp_path / "checkpoint.h5"
    code = (
        "import sys, numpy as np\nfrom pathlib import Path\n"
        "from lacoloco.datasets.artifact import write_artifact\n"
        "for seed in range(10**6):\n"
        "    write_artifact(Path(sys.argv[1]), 'lacoloco/checkpoint',"
        " {'a': np.full(200_000, seed)}, metadata={}, config={}, seed=seed, robot=None,"
        " replace=True)\n"
    )
    writer = subprocess.Popen([sys.executable, "-c", code, str(path)])
    deadline = time.monotonic() + 60
    while not path.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    for _ in range(5):
        seen = read_artifact(path)
        assert (seen.arrays["a"] == seen.seed).all()
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    kept = read_artifact(path)
    assert (kept.arrays["a"] == kept.seed).all()


def test_every_flipped_byte_is_refused_or_harmless(write, tmp_path):
    """What still reads after a flip, in structure or data, is exactly what was written."""
    path = write(arrays={"a": np.arange(20.0), "b": np.arange(3, dtype=np.uint8)})
    original, content = read_artifact(path), path.read_bytes()
    start = content.index(np.arange(20.0).tobytes())
    refused = 0
    damaged = tmp_path / "damaged.h5"
    for index in range(0, len(content), 7):  # all of them pass too, in 20 s
        altered = bytearray(content)
        altered[index] ^= 0x10
        damaged.write_bytes(altered)
        try:
            result = read_artifact(damaged, "lacoloco/motions")
        except ArtifactError as error:
            assert "\n" not in str(error)
            refused += 1
            continue
        assert not start <= index < start + 160
        assert result.content_hash == original.content_hash
        assert result.data_hash == original.data_hash
    assert refused > 100


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"\x89PNG\r\n\x1a\n" + bytes(100), "not an HDF5 file"),
        (b"\x89HDF\r\n\x1a\n" + bytes(100), "cut short or damaged"),
        (b"HIERARCHY\nROOT Hips\n", "not an HDF5 file"),
    ],
)
def test_files_that_are_no_artifacts(tmp_path, content, words):
    path = tmp_path / "bad.h5"
    path.write_bytes(content)
    with pytest.raises(ArtifactError, match=words) as caught:
        read_artifact(path)
    one_line(caught, path)


def test_missing_file_and_directory(tmp_path):
    with pytest.raises(ArtifactError, match="no such artifact"):
        read_artifact(tmp_path / "none.h5")
    with pytest.raises(ArtifactError, match="is a directory"):
        read_artifact(tmp_path)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_truncated_file(write, share):
    path = write()
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ArtifactError, match="cut short or damaged") as caught:
        read_artifact(path)
    one_line(caught, path)


def test_foreign_hdf5_file(tmp_path):
    path = tmp_path / "foreign.h5"
    with h5py.File(path, "w") as file:
        file["x"] = np.zeros(3)
    with pytest.raises(ArtifactError, match="no lacoloco artifact"):
        read_artifact(path)


def test_links_and_objects_are_not_followed(write, tmp_path):
    secret = tmp_path / "secret.h5"
    with h5py.File(secret, "w") as file:
        file["a"] = np.zeros(3)
    path = write()
    for link in (h5py.ExternalLink(str(secret), "a"), h5py.SoftLink("/arrays/big")):
        with h5py.File(path, "r+") as file:
            file["arrays"]["extra"] = link
        with pytest.raises(ArtifactError, match="damaged"):
            read_artifact(path)
        with h5py.File(path, "r+") as file:
            del file["arrays"]["extra"]


def test_other_schema_and_other_robot(write):
    path = write()
    with pytest.raises(ArtifactError, match="holds 'lacoloco/motions'") as caught:
        read_artifact(path, "lacoloco/policy")
    one_line(caught, path, "lacoloco/policy")
    with pytest.raises(ArtifactError, match="belongs to robot 'solo12', not to 'h1'") as caught:
        read_artifact(path, robot="h1")
    one_line(caught, path)
    with pytest.raises(ArtifactError, match="belongs to no robot"):
        read_artifact(write("none.h5", robot=None), robot="h1")


@pytest.mark.parametrize(("shift", "words"), [(1, "upgrade lacoloco"), (-1, "run the stage again")])
def test_newer_and_older_versions_say_who_wrote_them(write, monkeypatch, shift, words):
    with monkeypatch.context() as patch:
        patch.setitem(SCHEMAS, "lacoloco/policy", SCHEMAS["lacoloco/policy"] + shift)
        patch.setattr(artifacts.provenance, "lacoloco_version", lambda: "9.8.7")
        path = write(schema="lacoloco/policy", metadata={})
    with pytest.raises(ArtifactError, match=words) as caught:
        read_artifact(path)
    one_line(caught, path, "9.8.7")


def test_values_that_an_artifact_does_not_hold(write):
    with pytest.raises(TypeError, match="names"):
        write(arrays={"names": np.array(["a", "b"])})
    with pytest.raises(TypeError, match="object"):
        write(config={"value": object()})


def test_missing_parent_is_named(write, tmp_path):
    with pytest.raises(ArtifactError, match="no such file") as caught:
        write(parents=[tmp_path / "gone.bvh"])
    one_line(caught, "gone.bvh")


def test_parents_are_relative_inside_a_runs_directory_and_absolute_outside(write, tmp_path):
    mocap = tmp_path / "dog.bvh"
    mocap.write_text("HIERARCHY")
    first = write("runs/dog/retarget/.0001.partial/artifact.h5", parents=[mocap])
    second = write("runs/dog/train-low/.0001.partial/artifact.h5", parents=[first])
    assert read_artifact(first).parents[0].path == str(mocap)
    parent = read_artifact(second).parents[0]
    assert parent.path == "../../retarget/.0001.partial/artifact.h5"
    assert os.path.samefile(parent.locate(second), first)


def test_header_is_plain_text_for_other_tools(write):
    with h5py.File(write(), "r") as file:
        assert json.loads(bytes(file.attrs["config"])) == {"rate": 0.1}


def test_a_file_whose_name_fills_the_file_systems_limit_is_written(tmp_path):
    path = tmp_path / ("x" * 252 + ".h5")
    assert write_file(path, b"content").read_bytes() == b"content"
    assert list(tmp_path.iterdir()) == [path]
