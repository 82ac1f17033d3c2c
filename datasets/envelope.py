"""The file format below an artifact: a header of attributes and plain arrays, in HDF5."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np

from lacoloco.datasets.errors import ArtifactError, storage_errors

RawHeader = dict[str, bytes | int]
"""Header attributes exactly as stored: text as UTF-8 bytes, numbers as integers."""

NUMBERS = "biuf"
"""Kinds of arrays that are kept: bool, signed, unsigned, float; no objects, no references."""

DAMAGED = "cut short or damaged; restore a copy or run the stage that made it again"

_SIGNATURE = b"\x89HDF\r\n\x1a\n"


def pack(header: RawHeader, arrays: Mapping[str, np.ndarray]) -> bytes:
    """All bytes of the HDF5 file that holds a header and arrays.

    It is built in memory so that the file system sees one plain write with plain errors. Version
    1.10 of the format puts no limit on the size of attributes and checks its own structure.
    """
    size = sum(array.nbytes for array in arrays.values())
    with h5py.File(
        "artifact",
        "w",
        driver="core",
        backing_store=False,
        libver=("v110", "v110"),
        block_size=max(1 << 16, size // 4),
    ) as file:
        for name, value in header.items():
            file.attrs[name] = np.bytes_(value) if isinstance(value, bytes) else value
        group = file.create_group("arrays")
        for name, array in arrays.items():
            group.create_dataset(name, data=array)
        file.flush()
        return file.id.get_file_image()


def unpack(path: Path, *, with_arrays: bool = True) -> tuple[RawHeader, dict[str, np.ndarray]]:
    """Read header and arrays of the HDF5 file at `path`; the arrays are empty if not wanted.

    Raises:
        ArtifactError: missing, unreadable, empty, another kind of file, or damaged.
    """
    size = _check_signature(path)
    try:
        # No locks: they fail on read-only and network file systems, and artifacts never change.
        with h5py.File(path, "r", locking=False) as file:
            header = {name: _attribute(value) for name, value in file.attrs.items()}
            arrays: dict[str, np.ndarray] = {}
            if with_arrays and "arrays" in file:
                _collect(file["arrays"], "", arrays, size)
            return header, arrays
    except Exception as error:  # whatever HDF5 makes of foreign bytes, the file is to blame
        raise ArtifactError(f"{path}: {DAMAGED}") from error


def _check_signature(path: Path) -> int:
    """Size of the file in bytes, once it looks like HDF5 from outside."""
    with storage_errors(path, "read"):
        if path.is_dir():
            raise ArtifactError(f"{path}: is a directory; name the artifact.h5 in it")
        if not path.exists():
            raise ArtifactError(
                f"{path}: no such artifact; `lacoloco runs list` shows what there is"
            )
        size = path.stat().st_size
        with path.open("rb") as stream:
            start = stream.read(len(_SIGNATURE))
    if not start:
        raise ArtifactError(f"{path}: the file is empty; {DAMAGED}")
    if start != _SIGNATURE:
        raise ArtifactError(f"{path}: not an HDF5 file, so no lacoloco artifact")
    return size


def _attribute(value: object) -> bytes | int:
    if isinstance(value, np.bytes_):
        return bytes(value)
    if isinstance(value, np.integer):
        return int(value)
    raise TypeError(f"attribute of type {type(value)}")


def _collect(group: h5py.Group, prefix: str, arrays: dict[str, np.ndarray], limit: int) -> None:
    """Read all arrays below a group; links, filters and external storage are not followed."""
    for name in group:
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise TypeError(f"{prefix}{name} is a link")
        item = group[name]
        if isinstance(item, h5py.Group):
            _collect(item, f"{prefix}{name}/", arrays, limit)
            continue
        plain = item.dtype.kind in NUMBERS and not item.external and not item.is_virtual
        if not plain or item.id.get_create_plist().get_nfilters() or item.nbytes > limit:
            raise TypeError(f"{prefix}{name} is no plain array")
        arrays[prefix + name] = np.asarray(item[()])
