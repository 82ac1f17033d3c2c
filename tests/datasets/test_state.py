import json
import random

import numpy as np
import pytest
import torch

from lacoloco.datasets.artifact import read_artifact, write_artifact
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.state import flatten_state, unflatten_state


def identical(a, b):
    assert type(a) is type(b), (a, b)
    if isinstance(a, dict):
        assert list(a) == list(b)
        assert [type(key) for key in a] == [type(key) for key in b]
        return all(identical(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)):
        assert len(a) == len(b)
        return all(identical(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, torch.Tensor):
        assert (a.dtype, a.shape) == (b.dtype, b.shape)
        if a.dtype == torch.bfloat16:
            a, b = a.view(torch.int16), b.view(torch.int16)
        a, b = a.numpy(), b.numpy()
    if isinstance(a, (np.ndarray, np.generic)):
        assert (a.dtype, a.shape) == (b.dtype, b.shape)
        return a.tobytes() == b.tobytes()
    return repr(a) == repr(b)


def through_a_file(state, tmp_path):
    arrays, structure = flatten_state(state)
    path = write_artifact(
        tmp_path / "checkpoint.h5",
        "lacoloco/checkpoint",
        arrays,
        metadata={"state": structure},
        config={},
        seed=None,
        robot=None,
    )
    artifact = read_artifact(path)
    return unflatten_state(artifact.arrays, artifact.metadata["state"])


def test_every_kind_of_leaf_comes_back_bit_for_bit(tmp_path):
    state = {
        "float32": torch.tensor([0.1, float("nan"), -0.0]),
        "half": torch.tensor([0.1, 3.0], dtype=torch.bfloat16),
        "uint8": torch.arange(256, dtype=torch.uint8),
        "int64": torch.tensor([2**62, -1]),
        "bool": torch.tensor([True, False]),
        "scalar": torch.tensor(3),
        "empty": torch.zeros(0, 3),
        "transposed": torch.arange(6.0).reshape(2, 3).T,
        "numpy": np.array([1.5, np.inf]),
        "numpy scalar": np.float32(0.1),
        "numbers": [1, 2**80, -0.0, 0.1, float("inf"), True, None, "text with \u00e9"],
        "tuple": (1, (2, [3, ()])),
        0: {1: "int keys", 1.5: "float", False: "bool", None: "none"},
        "": "empty key",
    }
    state["numbers"].append(float("nan"))
    assert identical(state, through_a_file(state, tmp_path))


def test_awkward_keys_do_not_collide(tmp_path):
    state = {
        "a/b": torch.tensor([1]),
        "a": {"b": torch.tensor([2])},
        "a b": torch.tensor([3]),
        "a_b": torch.tensor([4]),
        ".": torch.tensor([5]),
        "..": {"/": torch.tensor([6])},
        0: torch.tensor([7]),
        "0": torch.tensor([8]),
        "x": {"y": torch.tensor([9])},
    }
    assert identical(state, through_a_file(state, tmp_path))


def test_training_continues_exactly_as_if_it_had_not_stopped(tmp_path):
    def fresh():
        torch.manual_seed(3)
        model = torch.nn.Sequential(torch.nn.Linear(3, 5), torch.nn.ELU(), torch.nn.Linear(5, 1))
        return model, torch.optim.Adam(model.parameters(), lr=1e-2)

    def train(model, optimizer, steps):
        for _ in range(steps):
            optimizer.zero_grad()
            model(torch.randn(8, 3)).square().mean().backward()
            optimizer.step()
        return torch.cat([p.detach().flatten() for p in model.parameters()])

    model, optimizer = fresh()
    train(model, optimizer, 5)
    state = {
        "model": model.state_dict(),
        "optimizer": optimizer.state_dict(),
        "torch": torch.get_rng_state(),
        "python": random.getstate(),
        "numpy": np.random.default_rng(1).bit_generator.state,
    }
    restored = through_a_file(state, tmp_path)
    expected = train(model, optimizer, 5)

    model, optimizer = fresh()
    model.load_state_dict(restored["model"])
    optimizer.load_state_dict(restored["optimizer"])
    torch.set_rng_state(restored["torch"])
    random.setstate(restored["python"])
    assert train(model, optimizer, 5).equal(expected)
    assert restored["numpy"] == state["numpy"]


def test_flattening_copies(tmp_path):
    weights = torch.zeros(3, requires_grad=True)
    arrays, structure = flatten_state({"w": weights})
    with torch.no_grad():
        weights += 1
    restored = unflatten_state(arrays, structure)["w"]
    assert restored.tolist() == [0, 0, 0]
    restored += 1
    assert arrays["w"].tolist() == [0, 0, 0]


@pytest.mark.parametrize("value", [object(), {1, 2}, np.array(["a"]), lambda: None, {(1, 2): 3}])
def test_other_kinds_are_refused_with_their_place(value):
    with pytest.raises(TypeError, match="model/bad"):
        flatten_state({"model": {"bad": value}})


@pytest.mark.parametrize(
    "structure",
    [
        {},
        {"kind": "dict"},
        {"kind": "value", "value": 3},
        {"kind": "list", "items": []},
        {"kind": "dict", "items": [["a", {"kind": "tensor", "array": "gone"}]]},
        {"kind": "dict", "items": [["a", {"kind": "os.system", "value": "true"}]]},
    ],
)
def test_structures_that_do_not_fit_are_refused(structure):
    with pytest.raises(ArtifactError, match="run the stage"):
        unflatten_state({}, json.loads(json.dumps(structure)))
