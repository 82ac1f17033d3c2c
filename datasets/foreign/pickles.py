"""Pickles without executing them: NumPy arrays of numbers, and plain containers, only.

A pickle is a program that calls what it names. Here it can name the few things below, and each
stands for code of ours that makes an array from bytes; NumPy's own functions, which can be led to
read memory that is not theirs, are not called either.
"""

from __future__ import annotations

import io
import pickle
import re
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from lacoloco.datasets.errors import DatasetError, storage_errors

MOST_BYTES = 2 << 30
_KIND = re.compile(r"[<>|=]?[biuf][1248]")


class RefusedError(DatasetError):
    """The pickle names something that is not data."""


class _Kind:
    """Stands for `numpy.dtype`: kind, size and byte order of numbers."""

    def __init__(self, text: object, *_: object) -> None:
        if not isinstance(text, str) or not _KIND.fullmatch(text):
            raise RefusedError(f"holds an array of {str(text)[:40]!r}, not of numbers")
        self.text, self.order = text.lstrip("<>|="), "<"

    def __setstate__(self, state: Any) -> None:
        """Take the byte order; whatever else a state says is not for plain numbers."""
        self.order = ">" if state[1] == ">" else "<"

    def array(self, content: object, shape: object, fortran: object) -> np.ndarray:
        """A copy of the bytes as an array."""
        if not isinstance(content, bytes | bytearray) or not isinstance(shape, tuple):
            raise RefusedError("holds an array of something other than bytes")
        values = np.frombuffer(content, np.dtype(self.order + self.text))
        return values.reshape(shape, order="F" if fortran in (True, "F") else "C").copy()


class _Array:
    """Stands for `numpy.ndarray`, which is made empty and then told its content."""

    values = np.zeros(0)

    def __setstate__(self, state: Any) -> None:
        """Take version, shape, kind, order and bytes."""
        _, shape, kind, fortran, content = state
        self.values = _kind(kind).array(content, shape, fortran)


def _kind(value: object) -> _Kind:
    if not isinstance(value, _Kind):
        raise RefusedError("holds an array of no kind")
    return value


def _empty(*_: object) -> _Array:
    """Stands for NumPy's `_reconstruct`."""
    return _Array()


def _scalar(kind: object, content: object = b"") -> object:
    """Stands for NumPy's `scalar`."""
    return _kind(kind).array(content, (), False).item()


def _from_buffer(content: object, kind: object, shape: object, order: object = "C") -> _Array:
    """Stands for NumPy's `_frombuffer`."""
    made = _Array()
    made.values = _kind(kind).array(content, shape, order)
    return made


def _encoded(text: object, *_: object) -> bytes:
    """Stands for `codecs.encode`, with which old protocols write bytes."""
    if not isinstance(text, str):
        raise RefusedError("encodes something other than text")
    return text.encode("latin1")


def _no_bytes(*arguments: object) -> bytes:
    """Stands for `bytes`, by which old protocols write that there are none."""
    if arguments:
        raise RefusedError("makes bytes of something else")
    return b""


def _table(*arguments: object) -> dict[Any, Any]:
    """Stands for `collections.OrderedDict`."""
    if arguments:
        raise RefusedError("makes a table of something else")
    return {}


_NUMPY = {
    ("multiarray", "_reconstruct"): _empty,
    ("multiarray", "scalar"): _scalar,
    ("numeric", "_frombuffer"): _from_buffer,
}
_ALLOWED: dict[tuple[str, str], Any] = {
    **{
        (f"numpy.{core}.{module}", name): stand_in
        for core in ("core", "_core")
        for (module, name), stand_in in _NUMPY.items()
    },
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Kind,
    ("_codecs", "encode"): _encoded,
    ("__builtin__", "bytes"): _no_bytes,
    ("collections", "OrderedDict"): _table,
}


class _Reader(pickle.Unpickler):
    """Knows nothing but `_ALLOWED`."""

    def find_class(self, module: str, name: str) -> Any:
        """What stands for a name.

        Raises:
            RefusedError: It is not among those that are allowed.
        """
        try:
            return _ALLOWED[module, name]
        except KeyError:
            raise RefusedError(f"names {f'{module}.{name}'[:80]}, which is not data") from None

    def persistent_load(self, _: object) -> NoReturn:
        """Refuse what lies outside the pickle, as torch writes it."""
        raise RefusedError("refers to something outside of it")


def read_pickle(path: Path) -> Any:
    """What a pickle holds: dicts, lists, tuples, texts, numbers and arrays of numbers.

    Raises:
        DatasetError: It cannot be read, is no pickle, or names anything that is not data; the
            message is one line and names the file.
        ArtifactError: The file system refuses.
    """
    with storage_errors(path, "read"):
        if path.stat().st_size > MOST_BYTES:
            raise DatasetError(f"{path}: is larger than any motion (2 GiB)")
        content = path.read_bytes()
    try:
        return _plain(_Reader(io.BytesIO(content), encoding="latin1").load())
    except RefusedError as error:
        raise DatasetError(
            f"{path}: {error}; nothing of it was executed: save NumPy arrays and plain containers"
        ) from None
    except Exception as error:  # whatever foreign bytes lead to, the file is to blame
        raise DatasetError(f"{path}: is no pickle of NumPy arrays, or damaged") from error


def _plain(value: Any, depth: int = 0) -> Any:
    """The value with arrays in the place of what stands for them."""
    if depth > 8:
        raise RefusedError("holds containers in containers without end")
    if isinstance(value, _Array):
        return value.values
    if isinstance(value, dict):
        return {key: _plain(one, depth + 1) for key, one in value.items()}
    if isinstance(value, list | tuple) and any(not isinstance(one, int | float) for one in value):
        return [_plain(one, depth + 1) for one in value]
    if isinstance(value, tuple):
        return list(value)
    if value is None or isinstance(value, str | bytes | int | float | list):
        return value
    raise RefusedError(f"holds a {type(value).__name__.strip('_')}, which is not data")
