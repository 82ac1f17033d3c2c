"""`--json`: exactly one object on stdout, whatever else wants to print."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any


def to_json(value: Any) -> str:
    """Write one JSON object on one line; numbers that JSON lacks (NaN, inf) become null."""
    return json.dumps(_plain(value), allow_nan=False)


@contextmanager
def stdout_kept_clean(active: bool) -> Iterator[None]:
    """Send stdout to stderr, also what C code prints, while `active`."""
    if not active:
        yield
        return
    real = sys.stdout
    real.flush()
    saved = os.dup(1) if _is_descriptor_one(real) else None
    if saved is not None:
        os.dup2(2, 1)
    sys.stdout = sys.stderr
    try:
        yield
    finally:
        sys.stdout = real
        if saved is not None:
            os.dup2(saved, 1)
            os.close(saved)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy and torch, scalars and arrays
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    return str(value)


def _is_descriptor_one(stream: Any) -> bool:
    try:
        return stream.fileno() == 1
    except (OSError, ValueError, AttributeError):  # a test's or a notebook's stand-in
        return False
