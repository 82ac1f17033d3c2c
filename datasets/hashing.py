"""Content hashes: what makes a flipped byte visible and a result traceable."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from lacoloco.datasets.errors import ArtifactError, storage_errors


def hash_file(path: Path) -> str:
    """SHA-256 of a file's bytes, 64 hexadecimal digits.

    Raises:
        ArtifactError: the file is missing or cannot be read.
    """
    if not path.is_file():
        raise ArtifactError(f"{path}: no such file")
    with storage_errors(path, "read"), path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def hash_arrays(arrays: Mapping[str, np.ndarray]) -> str:
    """SHA-256 over names, types, shapes and contents of arrays, whatever their order.

    It depends on the data alone: two runs that computed the same numbers give the same hash.
    """
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.asarray(arrays[name], order="C")
        digest.update(f"{name}\0{array.dtype.str}\0{array.shape}\0".encode())
        digest.update(array.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def hash_content(header: Mapping[str, bytes | int], data_hash: str) -> str:
    """SHA-256 over a header exactly as stored and the hash of the arrays that belong to it."""
    digest = hashlib.sha256(data_hash.encode())
    for name in sorted(header):
        digest.update(f"{name}\0{type(header[name]).__name__}\0".encode())
        value = header[name]
        digest.update(value if isinstance(value, bytes) else str(value).encode())
        digest.update(b"\0")
    return digest.hexdigest()
