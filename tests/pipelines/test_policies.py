"""Policies as artifacts."""

import json

import numpy as np
import pytest
import torch

from lacoloco.datasets import published
from lacoloco.datasets.artifact import read_artifact, write_artifact
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.exporting.onnx_files import largest_difference, write_onnx
from lacoloco.pipelines.learn.networks import NetworkConfig, make_actor
from lacoloco.pipelines.policies import Head, Policy, load_policies, save_policies
from lacoloco.pipelines.stage import StageContext


@pytest.fixture
def make_policy():
    usual = NetworkConfig(actor=(16, 8), critic=(4,))

    def factory(role, sizes, actions, networks=usual):
        layout = [{"name": "base_height", "slice": [0, 1], "unit": "m", "frame": "world"}]
        actor = make_actor(sizes, actions, networks)
        example = {name: 3.0 + 2.0 * torch.randn(200, size) for name, size in sizes.items()}
        actor.update_normalization(example)
        return Policy(Head(role, sizes, actions, networks, layout, "imitate"), actor.eval())

    return factory


@pytest.fixture
def both(make_policy):
    return [
        make_policy("low", {"policy": 6, "latent": 3}, 4),
        make_policy("high", {"policy": 5}, 3),
    ]


@pytest.fixture
def path(tmp_path, both, solo12):
    context = StageContext(RunStore(tmp_path), "run", seed=5, command="lacoloco train-high")
    return save_policies(
        tmp_path / "artifact.h5",
        both,
        spec=solo12,
        context=context,
        config={"worlds": 3},
        parents=[],
        metrics={"samples": 10},
        metadata={"method": "drail"},
    )


def test_a_policy_acts_the_same_after_a_round_trip(path, both, solo12):
    artifact, loaded = load_policies(path, "low", "high")
    for policy in both:
        groups = [torch.randn(9, size) for size in policy.head.sizes.values()]
        again = loaded[policy.head.role]
        assert again.head == policy.head
        assert torch.equal(again(*groups), policy(*groups))
        assert not again.actor.training
    assert artifact.seed == 5
    assert (artifact.robot, artifact.robot_hash) == (solo12.name, solo12.model_hash())
    assert artifact.metadata["method"] == "drail"
    assert artifact.metadata["metrics"] == {"samples": 10}


def test_a_loaded_policy_no_longer_moves_its_statistics(path):
    _, loaded = load_policies(path)
    actor = loaded["high"].actor
    before = actor.obs_normalizer.mean
    actor.update_normalization({"policy": torch.full((50, 5), 100.0)})
    assert torch.equal(actor.obs_normalizer.mean, before)


def test_actions_carry_no_gradient(both):
    assert not both[1](torch.randn(2, 5)).requires_grad


def test_every_group_must_be_given(both):
    with pytest.raises(ValueError, match="shorter|longer"):
        both[0](torch.randn(2, 6))


def test_a_role_that_is_not_there_is_named_with_those_that_are(path):
    with pytest.raises(ArtifactError, match=r"artifact.h5: holds low, high, not the walk policy"):
        load_policies(path, "low", "walk")


def test_motions_are_no_policy(tmp_path):
    motions = write_artifact(
        tmp_path / "motions.h5",
        "lacoloco/motions",
        {"x": np.zeros(3)},
        metadata={},
        config={},
        seed=None,
        robot=None,
    )
    with pytest.raises(ArtifactError, match=r"motions.h5"):
        load_policies(motions)


def test_a_policy_with_a_flipped_bit_in_a_weight_is_refused(path, both):
    data = bytearray(path.read_bytes())
    weight = both[0].actor.mlp[0].weight.detach().numpy().tobytes()
    data[data.index(weight)] ^= 1
    path.write_bytes(data)
    with pytest.raises(ArtifactError, match=r"artifact.h5"):
        load_policies(path)


@pytest.mark.parametrize("name", ["solo12-experts", "solo12-synthetic-low", "solo12-synthetic"])
def test_published_policies_of_earlier_versions_load(name):
    path = published.find(name)
    artifact, policies = load_policies(path)
    assert policies.keys() == artifact.metadata["heads"].keys()


HOSTILE = [
    (("networks", "actor"), [60_000, 60_000], "networks.actor"),
    (("networks", "actor"), [4096, 4096, 4096], "weights, of which"),
    (("networks", "actor"), [], "networks.actor"),
    (("networks", "actor"), "16", "networks.actor"),
    (("networks", "activation"), "os.system", "networks.activation"),
    (("networks", "init_std"), -1.0, "networks.init_std"),
    (("sizes",), {"policy": 10**9, "latent": 3}, "weights, of which"),
    (("sizes",), {"policy": "6", "latent": 3}, "widths"),
    (("sizes",), [6, 3], ""),
    (("actions",), 5, ""),
    (("actions",), -4, "widths"),
    (("layout",), 5, "layout or task"),
    (("task",), None, "layout or task"),
    ((), 5, ""),
    ((), {"other": 1}, ""),
]


@pytest.mark.parametrize(("place", "value", "words"), HOSTILE)
def test_stored_networks_are_checked_before_they_are_built(path, tmp_path, place, value, words):
    stored = read_artifact(path)
    metadata = json.loads(json.dumps(stored.metadata))
    at, keys = metadata["heads"], ["low", *place]
    for key in keys[:-1]:
        at = at[key]
    at[keys[-1]] = value
    altered = write_artifact(
        tmp_path / "altered.h5",
        "lacoloco/policy",
        stored.arrays,
        metadata=metadata,
        config={},
        seed=0,
        robot=None,
    )
    with pytest.raises(ArtifactError, match="do not fit together") as caught:
        load_policies(altered)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_style_network_and_a_learned_std_are_kept_and_exported(make_policy, solo12, tmp_path):
    """And the tanh of a high level's mean."""
    style = NetworkConfig(actor=(16,), critic=(4,), style=(12, 6), learn_std=True)
    low = make_policy("low", {"policy": 6, "latent": 3}, 4, style)
    high = make_policy("high", {"policy": 5}, 3, NetworkConfig(actor=(8,), bounded_mean=True))
    with torch.no_grad():
        low.actor.distribution.log_std_param.copy_(torch.tensor([-1.0, -2.0, -3.0, -4.0]))
    context = StageContext(RunStore(tmp_path), "run", seed=5, command="lacoloco train-high")
    path = save_policies(
        tmp_path / "artifact.h5",
        [low, high],
        spec=solo12,
        context=context,
        config={},
        parents=[],
        metrics={},
    )
    loaded = load_policies(path, "low", "high")[1]
    kept = loaded["low"].actor.distribution.log_std_param
    assert kept.tolist() == [-1.0, -2.0, -3.0, -4.0]
    for policy in (low, high):
        groups = tuple(torch.randn(9, size) for size in policy.head.sizes.values())
        again = loaded[policy.head.role]
        assert again.head == policy.head and torch.equal(again(*groups), policy(*groups))
        output = {"levels": {policy.head.role: {"output": "out"}}}
        file = tmp_path / f"{policy.head.role}.onnx"
        write_onnx(again, file, output, opset=18)
        recorded = tuple(group.numpy() for group in groups)
        assert largest_difference(again, file, recorded, rows=8, seed=0) < 1e-5


def test_rounding_of_large_outputs_is_no_difference(make_policy, tmp_path):
    """As a humanoid's joints have them: far from their default position."""
    low = make_policy("low", {"policy": 60, "latent": 3}, 4, NetworkConfig(actor=(256, 128)))
    with torch.no_grad():
        low.actor.mlp[-1].weight.mul_(1e3)
    write_onnx(low, tmp_path / "low.onnx", {"levels": {"low": {"output": "out"}}}, opset=18)
    recorded = tuple(np.ones((4, size), np.float32) for size in low.head.sizes.values())
    assert largest_difference(low, tmp_path / "low.onnx", recorded, rows=256, seed=0) < 1e-5
