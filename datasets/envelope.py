"""The file format below an artifact: a header of attributes and plain arrays, in HDF5."""

from __future__ import annotations

import os
import stat
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

MOST_ATTRIBUTES = 64
"""A header has about 15."""
DEEPEST = 64
"""Groups within groups; the state of a training has about ten."""

MAPPED_FROM = 1 << 20
"""Bytes of an array; below, reading is as quick."""
_PAGE = 4096
"""Bytes to which larger arrays are aligned in a file, so that they can be mapped."""

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
        alignment_threshold=MAPPED_FROM,
        alignment_interval=_PAGE,
    ) as file:
        for name, value in header.items():
            file.attrs[name] = np.bytes_(value) if isinstance(value, bytes) else value
        group = file.create_group("arrays")
        for name, array in arrays.items():
            group.create_dataset(name, data=array)
        file.flush()
        return file.id.get_file_image()


def unpack(
    path: Path, *, with_arrays: bool = True, mapped: bool = False
) -> tuple[RawHeader, dict[str, np.ndarray]]:
    """Read header and arrays of the HDF5 file at `path`; the arrays are empty if not wanted.

    With `mapped`, floats of `MAPPED_FROM` bytes and more are mapped: their memory is the file's,
    which a process that writes to it does not change.

    Whatever a file claims, no more bytes are read than it has: see `_Reader`.

    Raises:
        ArtifactError: missing, unreadable, empty, another kind of file, damaged, or open for
            writing in another program.
    """
    size = _check_signature(path)
    try:
        # No locks: they fail on read-only and network file systems, and artifacts never change.
        with h5py.File(path, "r", locking=False) as file:
            reader = _Reader(size, path if mapped else None)
            header = reader.header(file)
            ours = "schema" in header  # another program's file is called so, not damaged
            return header, reader.arrays(file) if with_arrays and ours else {}
    except Exception as error:  # whatever HDF5 makes of foreign bytes, the file is to blame
        if "already open for write" in str(error):
            raise ArtifactError(
                f"{path}: another program has it open for writing; close it there and try again"
            ) from error
        if isinstance(error, _UnlikeOursError):
            raise ArtifactError(f"{path}: {error}: {DAMAGED}") from error
        raise ArtifactError(f"{path}: {DAMAGED}") from error


class _UnlikeOursError(TypeError):
    """The file holds what no artifact holds."""


class _Reader:
    """Reads a file as `pack` writes it, and refuses every other way to use HDF5.

    Every object is visited once, so that groups within themselves end; only hard links are
    followed, so that nothing outside the file is read; the arrays together have at most as many
    bytes as the file, so that none is larger than what was written.
    """

    def __init__(self, size: int, mapped: Path | None = None) -> None:
        """Take the size of the file in bytes, and its path where large arrays may be mapped."""
        self._left, self._seen, self._mapped = size, set[int](), mapped

    def header(self, file: h5py.File) -> RawHeader:
        """The root attributes: texts and whole numbers."""
        if len(file.attrs) > MOST_ATTRIBUTES:
            raise _UnlikeOursError("too many attributes")
        header: RawHeader = {}
        for name in file.attrs:
            stored = file.attrs.get_id(name)
            if stored.shape != () or stored.dtype.kind not in "Siu":
                raise _UnlikeOursError(f"attribute {_short(name)} is neither text nor number")
            self._take(stored.dtype.itemsize, name)
            value = file.attrs[name]
            header[name] = bytes(value) if stored.dtype.kind == "S" else int(value)
        return header

    def arrays(self, file: h5py.File) -> dict[str, np.ndarray]:
        """All arrays below the group `arrays`, by their names in it."""
        found: dict[str, np.ndarray] = {}
        if set(file) - {"arrays"}:
            raise _UnlikeOursError("it holds more than arrays")
        pending = [("", file, "arrays", 0)] if len(file) else []
        while pending:
            prefix, group, name, depth = pending.pop()
            item, place = self._once(group, name, prefix), f"{prefix}{name}"
            if isinstance(item, h5py.Group):
                if depth > DEEPEST:
                    raise _UnlikeOursError(f"{_short(place)} lies too deep")
                below = f"{place}/" if depth else ""
                pending += [(below, item, inner, depth + 1) for inner in item]
            elif depth:
                found[place] = self._array(item, place)
            else:
                raise _UnlikeOursError("arrays is no group")
        return found

    def _once(self, group: h5py.Group, name: str, prefix: str) -> h5py.HLObject:
        place = _short(f"{prefix}{name}")
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise _UnlikeOursError(f"{place} is a link")
        item = group[name]
        address = h5py.h5o.get_info(item.id).addr
        if address in self._seen:
            raise _UnlikeOursError(f"{place} is a second name of something else")
        self._seen.add(address)
        return item

    def _array(self, item: h5py.HLObject, place: str) -> np.ndarray:
        if not isinstance(item, h5py.Dataset) or item.shape is None:
            raise _UnlikeOursError(f"{_short(place)} is no array of numbers")
        made = item.id.get_create_plist()
        whole = made.get_layout() in (h5py.h5d.CONTIGUOUS, h5py.h5d.COMPACT)
        if item.dtype.kind not in NUMBERS or not whole or item.external or made.get_nfilters():
            raise _UnlikeOursError(f"{_short(place)} is no plain array")
        if item.id.get_storage_size() != item.nbytes:
            raise _UnlikeOursError(f"{_short(place)} was never written")
        self._take(item.nbytes, place)
        large = item.dtype.kind == "f" and item.nbytes >= MAPPED_FROM
        at = item.id.get_offset()
        if self._mapped is not None and large and at and at % item.dtype.alignment == 0:
            return np.asarray(np.memmap(self._mapped, item.dtype, "c", at, item.shape))
        return np.asarray(item[()])

    def _take(self, count: int, place: str) -> None:
        self._left -= count
        if self._left < 0:
            raise _UnlikeOursError(f"{_short(place)} has more bytes than the file")


def _short(name: str) -> str:
    text = name if len(name) <= 60 else f"{name[:60]}..."
    return repr(text)


def _check_signature(path: Path) -> int:
    """Size of the file in bytes, once it looks like HDF5 from outside."""
    with storage_errors(path, "read"):
        # Not blocking: a pipe would wait for a writer for ever.
        try:
            descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except FileNotFoundError:
            raise ArtifactError(
                f"{path}: no such artifact; `lacoloco runs list` shows what there is"
            ) from None
        try:
            status = os.fstat(descriptor)
            if stat.S_ISDIR(status.st_mode):
                raise ArtifactError(f"{path}: is a directory; name the artifact.h5 in it")
            if not stat.S_ISREG(status.st_mode):
                raise ArtifactError(f"{path}: is no regular file, so no lacoloco artifact")
            start = os.read(descriptor, len(_SIGNATURE))
        finally:
            os.close(descriptor)
    if not start:
        raise ArtifactError(f"{path}: the file is empty; {DAMAGED}")
    if start != _SIGNATURE:
        raise ArtifactError(f"{path}: not an HDF5 file, so no lacoloco artifact")
    return status.st_size
