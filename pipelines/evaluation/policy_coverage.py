"""The skill coverage of a stored low level."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lacoloco.datasets.clip import load_clips
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.evaluation.skill_cells import CellCoverage
from lacoloco.pipelines.evaluation.skill_coverage import SkillCoverage
from lacoloco.pipelines.policies import load_policies, motions_of
from lacoloco.pipelines.robot import robot_of
from lacoloco.pipelines.stage import SILENT, Progress


def policy_coverage(
    policy: Path,
    motions: Sequence[Path] = (),
    *,
    latents: int,
    seed: int,
    progress: Progress = SILENT,
) -> CellCoverage:
    """Hold ``latents`` latents of a low level and compare with clips.

    Args:
        policy: Artifact that holds a low level.
        motions: Clips to compare with, drawn as often as in training; default: those that the
            policy was made of.
        latents: How many, drawn from ``seed``.
        seed: Also of the moments of the clips.
        progress: Told which robot is taken, and after every step how far it is.

    Raises:
        StageError: The motions are not to be found.
        ArtifactError: An input is missing or damaged, or there is no low level.
    """
    artifact, policies = load_policies(policy, "low")
    spec = robot_of(artifact, progress.say)
    clips = [
        clip for path in motions or motions_of(policy) for clip in load_clips(path, robot=spec.name)
    ]
    shares = dict(artifact.config.get("skill_shares") or ())
    library = MotionLibrary(
        clips, weighting="skill" if shares else "duration", skill_shares=shares or None
    )
    low = policies["low"]
    coverage = SkillCoverage(
        spec, library, latents=latents, seed=seed, observation=low.head.observation
    )
    return coverage.cells(low, progress)
