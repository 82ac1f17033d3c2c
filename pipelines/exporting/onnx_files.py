"""A policy's network as an ONNX file, checked against torch."""

from __future__ import annotations

import json
import logging
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.learn.latents import project
from lacoloco.pipelines.policies import Policy

TOLERANCE = 1e-5
"""Largest difference that rounding explains: of outputs up to 1, of larger ones as a share."""
INPUTS = {"policy": "observation", "latent": "latent"}
"""Observation group -> name of the ONNX input."""


class ExportedActor(nn.Module):
    """Normaliser, network and, for the high level, the projection to the sphere: what the ONNX file
    computes.
    """

    def __init__(self, policy: Policy) -> None:
        """Take a trained policy."""
        super().__init__()
        self.normalizer, self.mlp = policy.actor.obs_normalizer, policy.actor.mlp
        self.on_sphere = policy.head.role == "high"

    def forward(self, *groups: torch.Tensor) -> torch.Tensor:
        """(B, width) per observation group -> (B, actions), unit latents for the high level."""
        output = self.mlp(self.normalizer(torch.cat(groups, dim=-1)))
        return project(output) if self.on_sphere else output


def write_onnx(policy: Policy, path: Path, metadata: dict[str, Any], opset: int) -> None:
    """Export one actor as a single file with a named batch axis and the metadata under the key
    ``lacoloco``.
    """
    import onnx

    sizes = policy.head.sizes
    example = tuple(torch.zeros(2, size) for size in sizes.values())
    batch = torch.export.Dim("batch")
    with warnings.catch_warnings():
        # The exporter warns, and logs, about packages of its own that are not there; nothing of
        # ours.
        warnings.simplefilter("ignore")
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        program = torch.onnx.export(
            ExportedActor(policy).eval(),
            example,
            input_names=[INPUTS[group] for group in sizes],
            output_names=[metadata["levels"][policy.head.role]["output"]],
            dynamic_shapes=(tuple({0: batch} for _ in sizes),),
            opset_version=opset,
            dynamo=True,
            verbose=False,
        )
    assert program is not None
    model = program.model_proto
    entry = model.metadata_props.add()
    entry.key, entry.value = "lacoloco", json.dumps(metadata)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def largest_difference(
    policy: Policy, path: Path, recorded: tuple[np.ndarray, ...], rows: int, seed: int
) -> float:
    """Largest |onnxruntime - torch| / max(1, |torch|) over random and recorded observations.

    Raises:
        StageError: it exceeds ``TOLERANCE``.
    """
    import onnxruntime

    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    names = [entry.name for entry in session.get_inputs()]
    generator = torch.Generator().manual_seed(seed)
    random = tuple(
        torch.randn(rows, size, generator=generator) for size in policy.head.sizes.values()
    )
    actor, worst = ExportedActor(policy).eval(), 0.0
    for groups in (random, tuple(torch.from_numpy(array) for array in recorded)):
        with torch.no_grad():
            expected = actor(*groups).numpy()
        (found,) = session.run(
            None, {name: group.numpy() for name, group in zip(names, groups, strict=True)}
        )
        worst = max(worst, float((np.abs(found - expected) / np.abs(expected).clip(1.0)).max()))
    if worst > TOLERANCE:
        raise StageError(
            f"{path.name}: onnxruntime and torch differ by {worst:.2g}, more than {TOLERANCE:g}; "
            "please report it"
        )
    return worst
