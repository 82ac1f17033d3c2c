"""Stage export: a folder that runs a policy on a robot, or in plain MuJoCo, without lacoloco."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from lacoloco.datasets.artifact import write_artifact
from lacoloco.datasets.config_values import Within
from lacoloco.datasets.hashing import hash_file
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation.rollout import record_reach
from lacoloco.pipelines.exporting import controller
from lacoloco.pipelines.exporting.description import describe
from lacoloco.pipelines.exporting.onnx_files import largest_difference, write_onnx
from lacoloco.pipelines.policies import load_policies
from lacoloco.pipelines.robot import record_of, robot_of
from lacoloco.pipelines.stage import StageContext, StageResult
from lacoloco.robots.scene import scene_xml

DESCRIPTION, MODEL, CONTROLLER = "policy.json", "robot.xml", "controller.py"


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
    **dict.fromkeys(("laptop", "gpu", "paper", "paper-method"), ExportConfig),
}


def run(config: ExportConfig, context: StageContext, *, policy: Path) -> StageResult:
    """Write beside the artifact: both networks, ``policy.json`` that describes them, the model that
    they were trained on, and ``controller.py`` that runs them.

    Raises:
        StageError: onnxruntime and torch differ by more than rounding, or the policy observes
            what the controller does not know.
        ArtifactError: ``policy`` is missing, damaged, or holds no high level.
    """
    artifact, policies = load_policies(policy, "low", "high")
    spec = robot_of(artifact, context.progress.say)
    directory = context.store.begin(context.run, "export", at_once=True)
    recorded = record_reach(policy, seconds=config.recorded_seconds, episodes=4, seed=context.seed)
    observations = {"low": (recorded.low_obs, recorded.latent), "high": (recorded.high_obs,)}
    description = describe(policies, spec, artifact, recorded)
    worst = 0.0
    for role, policy_of in policies.items():
        path = directory.file(f"{role}.onnx")
        write_onnx(policy_of, path, description, config.opset)
        worst = max(
            worst,
            largest_difference(
                policy_of, path, observations[role], config.random_rows, context.seed
            ),
        )
    directory.file(MODEL).write_text(scene_xml(spec))
    shutil.copyfile(controller.__file__, directory.file(CONTROLLER))
    names = [f"{role}.onnx" for role in policies] + [MODEL, CONTROLLER]
    description["sha256"] = {name: hash_file(directory.file(name)) for name in names}
    directory.file(DESCRIPTION).write_text(json.dumps(description, indent=1) + "\n")
    write_artifact(
        directory.file("artifact.h5"),
        "lacoloco/export",
        {},
        metadata={"files": [*names, DESCRIPTION], "max_abs_difference": worst},
        config=asdict(config),
        seed=context.seed,
        robot=record_of(spec),
        parents=[policy],
        command=context.command,
    )
    final = directory.complete()
    onnx = {role: str(final.with_name(f"{role}.onnx")) for role in policies}
    return StageResult(
        final, {"folder": str(final.parent), "onnx": onnx, "max_abs_difference": worst}
    )


def check(folder: Path) -> dict[str, str]:
    """Name -> SHA-256 of the files of an exported folder.

    Raises:
        StageError: It is none, or its files do not belong together.
    """
    path = folder / DESCRIPTION
    try:
        description = json.loads(path.read_text(encoding="utf-8"))
        hashes = {str(name): str(value) for name, value in description["sha256"].items()}
    except OSError as error:
        raise StageError(f"{path}: {error.strerror}; give a folder of lacoloco export") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise StageError(f"{path}: not a description by lacoloco export") from error
    try:
        controller.check(folder, {"sha256": hashes})
    except ValueError as error:
        raise StageError(str(error)) from error
    return hashes
