"""Skill switching: what a high level does with the skills, over time: to walk first and to reach
last.

Played without noise, pushes and randomisation, motors as strong as they are; counted by
:mod:`lacoloco.pipelines.evaluation.skill_switching`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from lacoloco.datasets.artifact import read_header, write_artifact
from lacoloco.datasets.clip import load_clips
from lacoloco.datasets.config_values import Within
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation.rollout import record_reach
from lacoloco.pipelines.evaluation.skill_classifier import NearestClip
from lacoloco.pipelines.evaluation.skill_switching import LAST, compare
from lacoloco.pipelines.policies import motions_of
from lacoloco.pipelines.robot import record_of, robot_of
from lacoloco.pipelines.stage import StageContext, StageResult

STAGE = "switching"
SCHEMA = "lacoloco/switching"
PICTURE = "switching.png"


@dataclass(frozen=True)
class SwitchingConfig:
    """What is played and shown.

    Attributes:
        episodes: How many are counted.
        seconds: Length of an episode [s].
        shown: Number of the episode in the picture; -1 takes, of those that walk first and reach
            last (of all, where none does), the one with the median distance from the target at its
            end.
    """

    episodes: Annotated[int, Within(1, 131_072)] = 256
    seconds: Annotated[float, Within(0.02, 3600)] = 10.0
    shown: Annotated[int, Within(-1, 131_071)] = -1

    def conflict(self) -> str:
        """What does not fit together, "" if all does."""
        if self.shown < self.episodes:
            return ""
        return f"shown={self.shown}: there are only episodes 0 to {self.episodes - 1}"


PRESETS: dict[str, Callable[[], SwitchingConfig]] = {
    "smoke": lambda: SwitchingConfig(episodes=4, seconds=2.0),
    "laptop": lambda: SwitchingConfig(),
}


def run(
    config: SwitchingConfig, context: StageContext, *, policy: Path, motions: Sequence[Path] = ()
) -> StageResult:
    """Play a high-level policy, count the episodes that switch skills, and draw one.

    Args:
        config: how much.
        context: where, and the seed of the episodes.
        policy: artifact with both levels.
        motions: the clips to compare with; default: those that the policy was made of.

    Returns:
        The artifact; metrics of :meth:`Switching.metrics`, and ``picture``.

    Raises:
        StageError: the motions are not to be found, or have no reaching clips, or no others.
        ArtifactError: an input is missing or damaged.
    """
    from lacoloco.pipelines.plots.switching import draw_switching

    if told := config.conflict():
        raise StageError(told)
    motions = list(motions) or motions_of(policy)
    nearest = NearestClip([clip for path in motions for clip in load_clips(path)])
    if LAST not in nearest.skills or len(nearest.skills) < 2:
        raise StageError(
            f"{motions[0]}: no clips of '{LAST}' and of another skill; name other motions with "
            "--motions"
        )
    played = record_reach(
        policy,
        seconds=config.seconds,
        episodes=config.episodes,
        seed=context.seed,
        progress=context.progress,
    )
    found = compare(played, nearest)
    shown = config.shown if config.shown >= 0 else found.typical()
    directory = context.store.begin(context.run, STAGE, at_once=True)
    spec = robot_of(read_header(policy), context.progress.say)
    draw_switching(directory.file(PICTURE), found, played, shown, spec.feet)
    write_artifact(
        directory.file("artifact.h5"),
        SCHEMA,
        {
            "nearest": found.nearest,
            "error": found.error,
            "fell": found.fell,
            "latent": played.steering[shown],
        },
        metadata={
            "skills": found.skills,
            "fps": found.fps,
            "shown": shown,
            "metrics": found.metrics(),
        },
        config=asdict(config),
        seed=context.seed,
        robot=record_of(spec),
        parents=[policy, *motions],
        command=context.command,
    )
    done = directory.complete()
    metrics = {**found.metrics(), "episodes": config.episodes, "shown": shown}
    return StageResult(done, {**metrics, "picture": str(done.with_name(PICTURE))})
