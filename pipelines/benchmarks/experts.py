"""How good the experts of an artifact are, task by task."""

from __future__ import annotations

from pathlib import Path

from lacoloco.pipelines.generation.assessment import assess
from lacoloco.pipelines.generation.recorder import SKILLS
from lacoloco.pipelines.policies import load_policies
from lacoloco.pipelines.robot import robot_of

TRANSIENT_S = 1.0
"""Seconds after the start that do not count in the errors of velocities."""


def bench_experts(
    path: Path, *, episodes: int, seconds: float, seed: int, device: str
) -> dict[str, float | None]:
    """Assess every expert of an artifact; see
    :func:`~lacoloco.pipelines.generation.assessment.assess`.

    Raises:
        ArtifactError: It is damaged, or holds no experts.
        RobotError: Its robot cannot be read any more.
    """
    artifact, policies = load_policies(path, *SKILLS, device=device)
    spec = robot_of(artifact)
    found: dict[str, float | None] = {}
    for task in SKILLS:
        found |= assess(
            spec,
            task,
            policies[task],
            worlds=episodes,
            seconds=seconds,
            transient_s=min(TRANSIENT_S, 0.5 * seconds),
            seed=seed,
            device=device,
        )
    return found
