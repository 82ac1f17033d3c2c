"""Trained networks as artifacts: what was learned, and what it needs to be fed and how to be
used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import torch
from rsl_rl.models import MLPModel

from lacoloco.datasets.artifact import Artifact, read_artifact, read_header, write_artifact
from lacoloco.datasets.clip import SCHEMA as MOTIONS
from lacoloco.datasets.config_values import check_config
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.lineage import lineage
from lacoloco.datasets.old_names import translated
from lacoloco.datasets.state import flatten_state, unflatten_state
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.learn.networks import LATENT, NetworkConfig, make_actor
from lacoloco.pipelines.robot import record_of
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.hierarchical_env import LatentSteeredEnv
from lacoloco.pipelines.sim.observation import FULL, Observation, observation_of
from lacoloco.pipelines.sim.tasks import Task, load_task, task_from_text
from lacoloco.pipelines.stage import StageContext
from lacoloco.robots.spec import RobotSpec

SCHEMA = "lacoloco/policy"


@dataclass(frozen=True)
class Head:
    """One actor: its observation groups in order, its number of outputs and its network.

    Attributes:
        role: ``walk``, ``reach_in_place``, ``low`` or ``high``.
        sizes: observation group -> width.
        actions: number of outputs.
        networks: hidden layers and activation.
        layout: the columns of the group ``policy`` (see ``sim.state.layout``). It says what is
            observed, and so what an environment has to show.
        task: name of the task that it was trained on.
    """

    role: str
    sizes: dict[str, int]
    actions: int
    networks: NetworkConfig
    layout: list[dict[str, Any]]
    task: str

    @property
    def observation(self) -> Observation:
        """What it observes, as its layout says."""
        return observation_of(self.layout)


@dataclass(frozen=True)
class Policy:
    """A head with its weights; call it with one tensor per observation group to get deterministic
    actions.
    """

    head: Head
    actor: MLPModel

    @torch.no_grad()
    def __call__(self, *groups: torch.Tensor) -> torch.Tensor:
        """(N, width) per group -> (N, actions) mean actions."""
        return self.actor(dict(zip(self.head.sizes, groups, strict=True)))


def steered(env: LeggedEnv, policies: Mapping[str, Policy]) -> LatentSteeredEnv:
    """An environment that is driven through the low level of these policies. Both levels see what
    they were trained with; without a ``high`` one, all is to be seen.
    """
    low = policies["low"]
    high_sees = policies["high"].head.observation if "high" in policies else FULL
    return LatentSteeredEnv(env, low, low.head.sizes["latent"], low.head.observation, high_sees)


def save_policies(
    path: Path,
    policies: Sequence[Policy],
    *,
    spec: RobotSpec,
    context: StageContext,
    config: dict[str, Any],
    parents: Sequence[Path],
    metrics: dict[str, Any],
    metadata: dict[str, Any] | None = None,
) -> Path:
    """Write policies of one robot into one artifact, by role; a high level carries its low level
    with it.
    """
    state = {policy.head.role: policy.actor.state_dict() for policy in policies}
    arrays, structure = flatten_state(state)
    heads = {policy.head.role: asdict(policy.head) for policy in policies}
    return write_artifact(
        path,
        SCHEMA,
        arrays,
        metadata={"heads": heads, "structure": structure, "metrics": metrics, **(metadata or {})},
        config=config,
        seed=context.seed,
        robot=record_of(spec),
        parents=parents,
        command=context.command,
    )


def task_of(artifact: Artifact, spec: RobotSpec) -> Task:
    """The task that an artifact's high level was trained on: its own, or the robot's reach task.

    Raises:
        RobotError: This version cannot read the task that the artifact carries.
    """
    carried = artifact.metadata.get("task")
    if carried is None:
        return load_task(spec, "reach")
    return task_from_text(spec, carried["text"], Path(carried["file"]))


def load_policies(
    path: Path, *needed: str, device: str = "cpu"
) -> tuple[Artifact, dict[str, Policy]]:
    """Read an artifact's policies by role, ready to run.

    Raises:
        ArtifactError: not a policy, damaged, or a role in ``needed`` is not in it.
    """
    artifact = read_artifact(path, SCHEMA)
    try:
        states = unflatten_state(artifact.arrays, artifact.metadata["structure"])
        heads = {role: _head(data) for role, data in artifact.metadata["heads"].items()}
        for role, head in heads.items():
            _check_size(head, states[role])
        policies = {role: _restored(head, states[role], device) for role, head in heads.items()}
    except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        told = " ".join(str(error).split())[:200]
        raise ArtifactError(
            f"{path}: its networks do not fit together ({told}); run the stage that made it again"
        ) from error
    for role in needed:
        if role not in policies:
            raise ArtifactError(
                f"{path}: holds {', '.join(policies)}, not the {role} policy; name another artifact"
            )
    return artifact, policies


def motions_of(policy: Path) -> list[Path]:
    """The motion artifacts in a policy's lineage, as they were when it was trained.

    Raises:
        StageError: they are no longer there.
    """
    ancestors = [a for a in lineage(policy) if a.header is not None and a.header.schema == MOTIONS]
    found = [ancestor.path for ancestor in ancestors if ancestor.state == "ok"]
    if not found:
        what = read_header(policy).metadata.get("method", "policy")
        raise StageError(
            f"{policy}: the motions that this {what} was trained on are gone; name some with "
            "--motions"
        )
    return list(dict.fromkeys(found))


def _head(data: dict[str, Any]) -> Head:
    """A head as it was stored, every part of its type."""
    stored = translated("NetworkConfig", data["networks"])
    listed = {k: tuple(v) if isinstance(v, list) else v for k, v in stored.items()}
    networks = NetworkConfig(**cast("dict[str, Any]", listed))
    check_config(networks, "networks.")
    head = Head(**{**data, "networks": networks})
    widths = [head.actions, *dict(head.sizes).values()]
    if any(type(width) is not int or width < 1 for width in widths):
        raise ValueError(f"widths {widths} of a network's ends")
    if not isinstance(head.layout, list) or not isinstance(head.task, str):
        raise TypeError("layout or task is of another type")
    observation_of(head.layout)
    return head


def _check_size(head: Head, state: dict[str, torch.Tensor]) -> None:
    """Refuse a network with more weights than are stored, before memory is asked for it.

    Raises:
        ValueError: It has.
    """
    widths = [sum(head.sizes.values()), *head.networks.actor, head.actions]
    weights = _weights(widths)
    if head.networks.style:
        latent = head.sizes.get(LATENT, 0)
        weights += _weights([latent, *head.networks.style, latent])
    there = sum(value.numel() for value in state.values())
    if weights > there:
        raise ValueError(f"a network of {weights} weights, of which {there} are stored")


def _weights(widths: Sequence[int]) -> int:
    """Of the matrices of a network with layers of these widths."""
    return sum(first * second for first, second in zip(widths, widths[1:], strict=False))


def _restored(head: Head, state: dict[str, torch.Tensor], device: str) -> Policy:
    actor = make_actor(head.sizes, head.actions, head.networks)
    actor.load_state_dict(state)
    return Policy(head, actor.to(device).eval())
