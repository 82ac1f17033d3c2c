"""Stage export: both levels as ONNX files that carry all a robot needs to run them, checked against
torch.
"""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from torch import nn

from lacoloco.datasets.artifact import Artifact, write_artifact
from lacoloco.datasets.config_values import Within
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation.rollout import record_reach
from lacoloco.pipelines.learn.latents import project
from lacoloco.pipelines.policies import Policy, load_policies
from lacoloco.pipelines.robot import record_of, robot_of
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.robots.spec import RobotSpec

TOLERANCE = 1e-5
FORMAT_VERSION = 1
INPUTS = {"policy": "observation", "latent": "latent"}
"""Observation group -> name of the ONNX input."""


@dataclass(frozen=True)
class ExportConfig:
    """How the exported files are written and checked.

    Attributes:
        random_rows: random observations on which torch and onnxruntime are compared.
        recorded_seconds: length of the simulated motion on which they are compared, too [s].
        opset: version of ONNX's operators.
    """

    random_rows: Annotated[int, Within(1, 10**6)] = 256
    recorded_seconds: Annotated[float, Within(0.02, 3600)] = 4.0
    opset: Annotated[int, Within(18, 23)] = 18


PRESETS: dict[str, Callable[[], ExportConfig]] = {
    "smoke": lambda: ExportConfig(random_rows=8, recorded_seconds=0.2),
    # What follows is no larger for a policy that learned longer.
    **dict.fromkeys(("laptop", "gpu", "paper"), ExportConfig),
}


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


def run(config: ExportConfig, context: StageContext, *, policy: Path) -> StageResult:
    """Write ``low.onnx`` and ``high.onnx`` with ``low.json`` and ``high.json`` beside the artifact.

    Raises:
        StageError: onnxruntime and torch differ by more than 1e-5 somewhere.
        ArtifactError: ``policy`` is missing, damaged, or holds no high level.
    """
    artifact, policies = load_policies(policy, "low", "high")
    spec = robot_of(artifact, context.progress.say)
    directory = context.store.begin(context.run, "export", at_once=True)
    recorded = record_reach(policy, seconds=config.recorded_seconds, episodes=4, seed=context.seed)
    observations = {"low": (recorded.low_obs, recorded.latent), "high": (recorded.high_obs,)}
    files, worst = {}, 0.0
    for role in ("low", "high"):
        path = directory.file(f"{role}.onnx")
        metadata = describe(policies[role], spec, artifact)
        write_onnx(policies[role], path, metadata, config.opset)
        directory.file(f"{role}.json").write_text(json.dumps(metadata, indent=1) + "\n")
        worst = max(
            worst,
            largest_difference(policies[role], path, observations[role], config, context.seed),
        )
        files[role] = path.name
    write_artifact(
        directory.file("artifact.h5"),
        "lacoloco/export",
        {},
        metadata={"files": files, "max_abs_difference": worst},
        config=asdict(config),
        seed=context.seed,
        robot=record_of(spec),
        parents=[policy],
        command=context.command,
    )
    final = directory.complete()
    onnx = {role: str(final.with_name(name)) for role, name in files.items()}
    return StageResult(final, {"onnx": onnx, "max_abs_difference": worst})


def describe(policy: Policy, spec: RobotSpec, artifact: Artifact) -> dict[str, Any]:
    """Everything a controller must know, as plain JSON data; SI units, joints in ``joint_names``
    order.
    """
    return {
        "format": "lacoloco-onnx",
        "format_version": FORMAT_VERSION,
        "role": policy.head.role,
        "robot": spec.name,
        "robot_model_sha256": spec.model_hash(),
        "method": artifact.metadata["method"],
        "artifact_sha256": artifact.content_hash,
        "lacoloco_version": artifact.lacoloco_version,
        "git_commit": artifact.git_commit,
        "joint_names": list(spec.joint_names),
        "joint_stiffness": list(spec.stiffness),
        "joint_damping": list(spec.damping),
        "effort_limits": spec.effort_limits().tolist(),
        "default_joint_pos": list(spec.default_joint_pos),
        "action_scale": spec.action_scale,
        "action_rule": (
            "joint target = default_joint_pos + action_scale * action, held for control_dt"
        ),
        "control_dt": CONTROL_DT,
        "decision_dt": CONTROL_DT * HOLD_STEPS,
        "latent_hold_steps": HOLD_STEPS,
        "quaternion_order": "wxyz",
        "end_effector": {
            "body": spec.end_effector.body,
            "offset_m": list(spec.end_effector.offset),
        },
        "inputs": {INPUTS[group]: size for group, size in policy.head.sizes.items()},
        "output": "latent" if policy.head.role == "high" else "action",
        "output_size": policy.head.actions,
        "observation_terms": policy.head.layout,
    }


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
            output_names=[metadata["output"]],
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
    policy: Policy, path: Path, recorded: tuple[np.ndarray, ...], config: ExportConfig, seed: int
) -> float:
    """Largest |onnxruntime - torch| over random and recorded observations.

    Raises:
        StageError: it exceeds 1e-5.
    """
    import onnxruntime

    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    names = [entry.name for entry in session.get_inputs()]
    generator = torch.Generator().manual_seed(seed)
    random = tuple(
        torch.randn(config.random_rows, size, generator=generator)
        for size in policy.head.sizes.values()
    )
    actor, worst = ExportedActor(policy).eval(), 0.0
    for groups in (random, tuple(torch.from_numpy(array) for array in recorded)):
        with torch.no_grad():
            expected = actor(*groups).numpy()
        (found,) = session.run(
            None, {name: group.numpy() for name, group in zip(names, groups, strict=True)}
        )
        worst = max(worst, float(np.abs(found - expected).max()))
    if worst > TOLERANCE:
        raise StageError(
            f"{path.name}: onnxruntime and torch differ by {worst:.2g}, more than {TOLERANCE:g}; "
            "please report it"
        )
    return worst
