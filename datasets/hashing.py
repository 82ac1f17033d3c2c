"""Content hashes: what makes a flipped byte visible and a result traceable."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
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


BLOCKS = "blake2b, 8 MiB blocks"
"""Name of `hash_blocks` in a header."""
_BLOCK = 8 << 20


def hash_blocks(arrays: Mapping[str, np.ndarray]) -> str:
    """Hash over names, types, shapes and contents of arrays, whatever their order, as
    `hash_arrays`; of blocks, so that all cores share the work.

    It is the BLAKE2b of the names, types and shapes and of the BLAKE2b of each 8 MiB, 32 bytes
    long each. Without instructions for SHA-256 a core hashes twice as fast, too.
    """
    whole = hashlib.blake2b(digest_size=32)
    with ThreadPoolExecutor(available_cores()) as pool:
        for name in sorted(arrays):
            array = np.asarray(arrays[name], order="C")
            whole.update(f"{name}\0{array.dtype.str}\0{array.shape}\0".encode())
            content = array.reshape(-1).view(np.uint8)
            starts = range(0, len(content), _BLOCK)
            parts = [content[start : start + _BLOCK].data for start in starts]
            for digest in pool.map(_blake2b, parts):  # hashlib lets other threads run
                whole.update(digest)
    return whole.hexdigest()


def _blake2b(part: memoryview) -> bytes:
    return hashlib.blake2b(part, digest_size=32).digest()


def available_cores() -> int:
    """How many cores this process may use; at most 8, which memory hardly keeps up with."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return min(usable or 1, 8)


def hash_content(header: Mapping[str, bytes | int], data_hash: str) -> str:
    """SHA-256 over a header exactly as stored and the hash of the arrays that belong to it."""
    digest = hashlib.sha256(data_hash.encode())
    for name in sorted(header):
        digest.update(f"{name}\0{type(header[name]).__name__}\0".encode())
        value = header[name]
        digest.update(value if isinstance(value, bytes) else str(value).encode())
        digest.update(b"\0")
    return digest.hexdigest()
