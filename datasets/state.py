"""Nested program state (weights, optimisers, counters, random states) as arrays and JSON.

`flatten_state` takes apart what a `state_dict()` holds; the arrays go into an artifact's arrays and
the structure into its metadata. `unflatten_state` puts it together bit for bit, types included.
Only plain data comes back: nothing is imported or executed.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from lacoloco.datasets.errors import ArtifactError

_PLAIN = (bool, int, float, str, type(None))
_UNSAFE = re.compile(r"[^\w.:+-]")  # "/" would make an HDF5 group, "." alone means "here"


def flatten_state(nested: Mapping[Any, Any]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Split nested state into arrays by name and a structure of JSON values.

    Args:
        nested: mappings (keys: str, int, float, bool or None), lists and tuples of torch tensors
            of any device, NumPy arrays and scalars, numbers, strings, bools and None.

    Returns:
        The arrays (copies, on the CPU) and the structure that `unflatten_state` needs with them.

    Raises:
        TypeError: a value of another kind, named by its place.
    """
    arrays: dict[str, np.ndarray] = {}
    return arrays, _flatten(nested, "", arrays)


def unflatten_state(arrays: Mapping[str, np.ndarray], structure: Mapping[str, Any]) -> dict:
    """Put together what `flatten_state` took apart; tensors come back on the CPU.

    Raises:
        ArtifactError: the structure is not one of `flatten_state`, or an array is missing.
    """
    try:
        state = _unflatten(structure, arrays)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise ArtifactError(
            f"stored state does not fit together ({type(error).__name__}: {error}); run the stage"
            " that made it again"
        ) from error
    if not isinstance(state, dict):
        raise ArtifactError("stored state is no mapping; run the stage that made it again")
    return state


def _flatten(value: object, place: str, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    if isinstance(value, Mapping):
        for key in value:
            if type(key) not in _PLAIN:
                raise TypeError(f"state holds no key of type {type(key).__name__} at '{place}'")
        pairs = [[key, _flatten(item, f"{place}/{key}", arrays)] for key, item in value.items()]
        return {"kind": "dict", "items": pairs}
    if type(value) in (list, tuple) and isinstance(value, list | tuple):
        items = [_flatten(item, f"{place}/{index}", arrays) for index, item in enumerate(value)]
        return {"kind": type(value).__name__, "items": items}
    if type(value) in _PLAIN:
        return {"kind": "value", "value": value}
    return _flatten_array(value, place, arrays)


def _flatten_array(value: object, place: str, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    torch = sys.modules.get("torch")
    name = _free_name(place, arrays)
    if torch is not None and isinstance(value, torch.Tensor):
        tensor = value.detach().cpu().clone()
        node = {"kind": "tensor", "array": name}
        if tensor.dtype == torch.bfloat16:  # NumPy has no such type; its bits travel as int16
            tensor, node["dtype"] = tensor.view(torch.int16), "bfloat16"
        arrays[name] = tensor.numpy()
        return node
    if isinstance(value, (np.ndarray, np.generic)) and value.dtype.kind in "biuf":
        arrays[name] = np.array(value)
        return {"kind": "array" if isinstance(value, np.ndarray) else "scalar", "array": name}
    raise TypeError(f"state holds no {type(value).__name__} at '{place}'")


def _free_name(place: str, arrays: Mapping[str, np.ndarray]) -> str:
    parts = [_UNSAFE.sub("_", part) for part in place.split("/") if part.strip(".")]
    base = name = "/".join(parts) or "state"
    count = 1
    # A name must be neither taken nor used as a group, nor lie below an array.
    while any(f"{name}/".startswith(f"{n}/") or n.startswith(f"{name}/") for n in arrays):
        name, count = f"{base}~{count}", count + 1
    return name


def _unflatten(node: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> object:
    kind = node["kind"]
    if kind == "dict":
        return {key: _unflatten(item, arrays) for key, item in node["items"]}
    if kind in ("list", "tuple"):
        items = [_unflatten(item, arrays) for item in node["items"]]
        return items if kind == "list" else tuple(items)
    if kind == "value":
        return node["value"]
    array = arrays[node["array"]]
    if kind == "array":
        return np.array(array)
    if kind == "scalar":
        return array[()]
    if kind == "tensor":
        import torch

        tensor = torch.from_numpy(np.array(array))
        return tensor.view(torch.bfloat16) if node.get("dtype") == "bfloat16" else tensor
    raise ValueError(f"unknown kind '{kind}'")
