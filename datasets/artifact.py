"""One HDF5 envelope for everything a stage makes: arrays, configuration, provenance, hash.

Nothing in it is ever executed or unpickled. The root attributes are the header (text as UTF-8
bytes, structured values as JSON), the arrays lie below the group `arrays`, contiguous and
unfiltered. `content_hash` covers header and arrays and is verified on every read.
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lacoloco.datasets import provenance
from lacoloco.datasets.atomic_write import write_file
from lacoloco.datasets.beside import ARTIFACT, PARTIAL, inputs_at, seal
from lacoloco.datasets.envelope import DAMAGED, NUMBERS, RawHeader, pack, unpack
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.hashing import BLOCKS, hash_arrays, hash_blocks, hash_content
from lacoloco.datasets.metadata import checked
from lacoloco.datasets.provenance import Parent
from lacoloco.datasets.robot_record import RobotRecord

SCHEMAS: dict[str, int] = {
    "lacoloco/motions": 2,
    "lacoloco/policy": 1,
    "lacoloco/checkpoint": 1,
    "lacoloco/evaluation": 1,
    "lacoloco/export": 1,
    "lacoloco/playback": 1,
    "lacoloco/switching": 1,
    "lacoloco/experts": 1,
}
READABLE: dict[str, tuple[int, ...]] = {"lacoloco/motions": (1,)}
"""Older versions that are read as they are: see `FlatClips.stored`."""
HASHED_IN_BLOCKS = ("lacoloco/motions",)
"""Schemas of large arrays, whose hash is made by all cores."""

LONGEST_PATH = 4096
"""Letters in the path of a parent; Linux allows no more."""


@dataclass(frozen=True)
class Header:
    """What an artifact says about itself."""

    path: Path
    schema: str
    schema_version: int
    metadata: dict[str, Any]
    config: dict[str, Any]
    seed: int | None
    robot: str
    """Name of the robot the data belongs to, "" when it belongs to none."""
    robot_hash: str
    parents: tuple[Parent, ...]
    created: str
    command: str
    git_commit: str
    lacoloco_version: str
    content_hash: str
    robot_files: dict[str, str] = field(default_factory=dict)
    """Name -> text of the files in the robot's folder; empty in artifacts of before."""
    robot_folder: str = ""
    """Where that folder lay; "" for a robot that comes with lacoloco."""
    files: dict[str, str] | None = None
    """Name -> SHA-256 of the files beside it; None where they were not hashed."""

    @property
    def robot_record(self) -> RobotRecord:
        """All that is kept of the robot."""
        return RobotRecord(self.robot, self.robot_hash, self.robot_files, self.robot_folder)


@dataclass(frozen=True)
class Artifact(Header):
    """A verified artifact, read completely."""

    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    data_hash: str = ""
    """Hash of the arrays alone: equal for two runs that computed the same numbers."""


def write_artifact(
    path: Path,
    schema: str,
    arrays: Mapping[str, np.ndarray],
    *,
    metadata: Mapping[str, Any],
    config: Mapping[str, Any],
    seed: int | None,
    robot: RobotRecord | tuple[str, str] | None,
    parents: Sequence[Path] = (),
    command: str = "",
    replace: bool = False,
) -> Path:
    """Write an artifact in one step: a killed writer leaves no half file.

    That of an unfinished version keeps the hashes of the files beside it, so it is written last.

    Args:
        path: file to make; an existing one is refused.
        schema: a key of `SCHEMAS`.
        arrays: numeric arrays by name; a "/" in a name makes a group.
        metadata: what a reader needs besides the arrays; JSON values, dataclasses, paths, NumPy
            scalars.
        config: the resolved configuration of the stage.
        seed: seed of the stage, if it has one.
        robot: the robot, if the data belongs to one; name and model hash where no more is known.
        parents: the files it was made of, artifacts or not.
        command: the command line.
        replace: replace an existing file (checkpoints of a running stage only).

    Returns:
        `path`.

    Raises:
        ArtifactError: the name is taken, a parent is missing, or the file system refuses.
        TypeError: an array or a value of a kind that artifacts do not hold.
    """
    checked = {name: _numeric(name, array) for name, array in arrays.items()}
    header: RawHeader = {
        "schema": schema.encode(),
        "schema_version": SCHEMAS[schema],
        "lacoloco_version": provenance.lacoloco_version().encode(),
        "git_commit": provenance.git_commit().encode(),
        "created": provenance.timestamp().encode(),
        "command": command.encode(),
        "metadata": _to_json(metadata),
        "config": _to_json(config),
        "parents": _to_json(provenance.describe_parents(path, parents, inputs_at(path.parent))),
    }
    if seed is not None:
        header["seed"] = int(seed)
    if robot is not None:
        header |= _robot_attributes(RobotRecord(*robot))
    if path.name == ARTIFACT and path.parent.name.endswith(PARTIAL):
        header["files"] = _to_json(seal(path.parent))
    if schema in HASHED_IN_BLOCKS:
        header["hash"] = BLOCKS.encode()
    header = {name: value for name, value in header.items() if value != b""}
    header["content_hash"] = hash_content(header, _data_hash(header, checked)).encode()
    return write_file(path, pack(header, checked), replace=replace)


def read_artifact(
    path: Path, schema: str | None = None, *, robot: str | None = None, mapped: bool = False
) -> Artifact:
    """Read an artifact completely and verify its content hash.

    Args:
        path: file to read.
        schema: the schema it must have; None takes any that this version knows.
        robot: the robot it must belong to; None takes any.
        mapped: whether large arrays may be the bytes of the file itself, mapped into memory.

    Raises:
        ArtifactError: missing, not an artifact, cut short, altered, of another schema or schema
            version, or of another robot; the message names the file and what to do.
    """
    path = Path(path)
    raw, arrays = unpack(path, mapped=mapped)
    header = _parse_header(path, raw)
    _check_schema(header, schema)
    data_hash = _data_hash(raw, arrays)
    stored = raw.pop("content_hash", b"")
    if hash_content(raw, data_hash).encode() != stored:
        raise ArtifactError(f"{path}: its content does not match its hash: {DAMAGED}")
    if robot is not None and header.robot != robot:
        belongs = f"robot '{header.robot}'" if header.robot else "no robot"
        raise ArtifactError(
            f"{path}: belongs to {belongs}, not to '{robot}'; name another run or another --robot"
        )
    fields = {f.name: getattr(header, f.name) for f in dataclasses.fields(Header)}
    return Artifact(**fields, arrays=arrays, data_hash=data_hash)


def read_header(path: Path) -> Header:
    """Read what an artifact says about itself, without its arrays and without verifying them.

    Raises:
        ArtifactError: missing, not an artifact, or its header cannot be read.
    """
    path = Path(path)
    return _parse_header(path, unpack(path, with_arrays=False)[0])


def _data_hash(header: RawHeader, arrays: Mapping[str, np.ndarray]) -> str:
    """Hash of the arrays, by the way that the header names."""
    return hash_blocks(arrays) if header.get("hash") == BLOCKS.encode() else hash_arrays(arrays)


def _numeric(name: str, array: np.ndarray) -> np.ndarray:
    array = np.asarray(array, order="C")
    if array.dtype.kind not in NUMBERS:
        raise TypeError(f"array '{name}' has type {array.dtype}; artifacts hold numbers only")
    return array


def _robot_attributes(robot: RobotRecord) -> RawHeader:
    """The header's part about the robot; what is empty is left out."""
    files = _to_json(robot.files) if robot.files else b""
    texts = {"robot": robot.name, "robot_hash": robot.model_hash, "robot_folder": robot.folder}
    return {**{name: text.encode() for name, text in texts.items()}, "robot_files": files}


def _to_json(value: object) -> bytes:
    return json.dumps(value, default=_plain).encode()


def _plain(value: object) -> object:
    """JSON form of the values that configurations and metadata hold besides plain ones."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"artifacts hold no {type(value).__name__} ({value!r}) in config or metadata")


def _parse_header(path: Path, raw: RawHeader) -> Header:
    if "schema" not in raw or "schema_version" not in raw:
        raise ArtifactError(f"{path}: an HDF5 file, but no lacoloco artifact")
    try:
        text = {name: value.decode() for name, value in raw.items() if isinstance(value, bytes)}
        seed = raw.get("seed")
        return Header(
            path=path,
            schema=text["schema"],
            schema_version=int(raw["schema_version"]),
            metadata=checked(text["schema"], dict(json.loads(text["metadata"])), str(path)),
            config=dict(json.loads(text["config"])),
            seed=None if seed is None else int(seed),
            robot=text.get("robot", ""),
            robot_hash=text.get("robot_hash", ""),
            parents=_parents(json.loads(text["parents"])),
            created=text["created"],
            command=text.get("command", ""),
            git_commit=text.get("git_commit", ""),
            lacoloco_version=text["lacoloco_version"],
            content_hash=text["content_hash"],
            robot_files=_texts(json.loads(text.get("robot_files", "{}"))),
            robot_folder=text.get("robot_folder", ""),
            files=_texts(json.loads(text["files"])) if "files" in text else None,
        )
    except ArtifactError:
        raise
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ArtifactError(f"{path}: its header is {DAMAGED}") from error


def _parents(listed: object) -> tuple[Parent, ...]:
    """The parents, as they were read from JSON."""
    if not isinstance(listed, list):
        raise TypeError("a list of parents is expected")
    parents = tuple(Parent(**parent) for parent in listed)
    for parent in parents:
        if not isinstance(parent.path, str) or not isinstance(parent.sha256, str):
            raise TypeError("a parent has a path and a hash")
        if not 0 < len(os.fsencode(parent.path)) <= LONGEST_PATH or "\0" in parent.path:
            raise ValueError("no path of a file")
    return parents


def _texts(value: object) -> dict[str, str]:
    """Texts by name, as they were read from JSON."""
    if not isinstance(value, dict) or not all(isinstance(text, str) for text in value.values()):
        raise TypeError("a table of texts is expected")
    return value


def _check_schema(header: Header, expected: str | None) -> None:
    path, schema = header.path, header.schema
    if expected is not None and schema != expected:
        raise ArtifactError(f"{path}: holds '{schema}', but '{expected}' is needed here")
    known = SCHEMAS.get(schema)
    here = provenance.lacoloco_version()
    written = f"written by lacoloco {header.lacoloco_version}"
    if known is None:
        raise ArtifactError(
            f"{path}: schema '{schema}', {written}, is unknown to lacoloco {here}; upgrade"
            " lacoloco, or the file is damaged"
        )
    if header.schema_version > known:
        raise ArtifactError(
            f"{path}: '{schema}' version {header.schema_version}, {written}; lacoloco {here} reads"
            f" version {known}: upgrade lacoloco"
        )
    if header.schema_version < known and header.schema_version not in READABLE.get(schema, ()):
        raise ArtifactError(
            f"{path}: '{schema}' version {header.schema_version}, {written}; lacoloco {here} reads"
            f" version {known} and converts none: run the stage again, or install lacoloco"
            f" {header.lacoloco_version} to read it"
        )
