"""Stage play: motions or a policy -> a recording and a page that shows it in any browser.

The page (`playback.html`, beside the artifact) needs neither lacoloco nor a network.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated

import numpy as np

from lacoloco.datasets import clip as clips
from lacoloco.datasets.artifact import Artifact, read_artifact, write_artifact
from lacoloco.datasets.clip import Clip
from lacoloco.datasets.config_values import Form, Within
from lacoloco.datasets.store import ARTIFACT
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.robot import record_of, robot_of
from lacoloco.pipelines.stage import SILENT, Progress, StageContext, StageResult
from lacoloco.pipelines.viewing import recording as recordings
from lacoloco.pipelines.viewing.animal import with_animal
from lacoloco.pipelines.viewing.page import build_page
from lacoloco.pipelines.viewing.recording import Recording

STAGE = "play"
SCHEMA = "lacoloco/playback"
PAGE = "playback.html"


LATENTS = Form(r"|random|\d{1,10}", "random, a seed (a whole number from 0), or nothing")


@dataclass(frozen=True)
class PlaybackConfig:
    """How much is shown.

    Attributes:
        clips: Clips of a motion set that are shown, unless they are named; each skill gets its
            share.
        episodes: Episodes of a policy.
        seconds: Length of an episode.
        latents: What steers the low level. "": the high level; where there is none, latents drawn
            from the stage's seed, one per episode. "random": latents that change at random, as in
            training. A number: latents drawn from this seed, one per episode.
    """

    clips: Annotated[int, Within(1, 10_000)] = 8
    episodes: Annotated[int, Within(1, 10_000)] = 3
    seconds: Annotated[float, Within(0.02, 3600)] = 10.0
    latents: Annotated[str, LATENTS] = ""


def laptop() -> PlaybackConfig:
    """A page of a few megabytes."""
    return PlaybackConfig()


def smoke() -> PlaybackConfig:
    """One clip, or one second of a policy."""
    return PlaybackConfig(clips=1, episodes=1, seconds=1.0)


PRESETS: dict[str, Callable[[], PlaybackConfig]] = {
    "smoke": smoke,
    "laptop": laptop,
    "gpu": laptop,
    "paper": laptop,
    "paper-method": laptop,
}


def run(
    config: PlaybackConfig, context: StageContext, *, source: Path, names: Sequence[str] = ()
) -> StageResult:
    """Record what a motion set, a policy or an earlier playback shows, and write its page.

    Args:
        config: How much.
        context: Where.
        source: Artifact of motions, of a policy, or of a playback.
        names: Clips to show; default: a selection.

    Returns:
        The artifact; metrics `html` (path of the page), `robot`, and `recordings`.

    Raises:
        StageError: A clip that is not there, or an artifact of something else.
        ArtifactError: The source is missing or damaged.
    """
    artifact = read_artifact(source)
    shown = record(artifact, config, context.seed, names, context.progress)
    spec = robot_of(artifact, context.progress.say)
    for recording in shown:
        recording.validate(spec.num_joints)
    directory = context.store.begin(context.run, STAGE, at_once=True)
    title = title_of(artifact, spec.name, shown)
    page = build_page(spec, shown, title)
    directory.file(PAGE).write_text(page, encoding="utf-8")
    arrays, metadata = recordings.to_arrays(shown)
    write_artifact(
        directory.file("artifact.h5"),
        SCHEMA,
        arrays,
        metadata={**metadata, "title": title},
        config=asdict(config),
        seed=context.seed,
        robot=record_of(spec),
        parents=[source],
        command=context.command,
    )
    done = directory.complete()
    metrics = {
        "html": str(done.with_name(PAGE)),
        "robot": spec.name,
        "recordings": [recording.name for recording in shown],
    }
    return StageResult(done, metrics)


def record(
    artifact: Artifact,
    config: PlaybackConfig,
    seed: int = 0,
    names: Sequence[str] = (),
    progress: Progress = SILENT,
) -> list[Recording]:
    """What an artifact shows.

    Raises:
        StageError: It shows nothing, or has no clip of a name.
    """
    if artifact.schema == clips.SCHEMA:
        available = clips.clips_of(artifact)
        spec, chosen = robot_of(artifact), chosen_clips(available, config.clips, names)
        return [
            with_animal(recordings.from_clip(available[index]), artifact, index, spec)
            for index in chosen
        ]
    if artifact.schema == SCHEMA:
        return recordings.from_arrays(artifact.arrays, artifact.metadata)
    if artifact.schema == "lacoloco/policy":
        if config.latents or "high" not in artifact.metadata["heads"]:
            return low_recordings(artifact.path, config, seed, progress)
        return policy_recordings(artifact.path, config, seed, progress)
    raise StageError(
        f"{artifact.path}: '{artifact.schema}' shows nothing; play motions or a policy"
    )


def title_of(artifact: Artifact, robot: str, shown: Sequence[Recording]) -> str:
    """What a page shows, for its title: which policy or motions, of which robot, and how many."""
    if artifact.schema == SCHEMA and artifact.metadata.get("title"):
        return str(artifact.metadata["title"])
    kind = "clip" if artifact.schema == clips.SCHEMA else "episode"
    what = shown[0].name if len(shown) == 1 else f"{len(shown)} {kind}s"
    return f"{_name(artifact.path)} ({robot}), {what}"


def policy_recordings(
    policy: Path, config: PlaybackConfig, seed: int, progress: Progress = SILENT
) -> list[Recording]:
    """Episodes of the task that a high-level policy was trained on, steered by it.

    Raises:
        ArtifactError: The artifact holds no high level.
    """
    from lacoloco.pipelines.evaluation.rollout import record_reach

    played = record_reach(
        policy,
        seconds=config.seconds,
        episodes=config.episodes,
        seed=seed,
        progress=progress,
    )
    shown = []
    for index, qpos in enumerate(played.qpos):
        target = None if played.target is None else played.target[index]
        end = "fell" if played.fell[index] else "did not fall"
        if target is not None and not played.fell[index]:
            error = np.linalg.norm(played.end_effector[index, -1] - target[-1])
            end = f"{100 * error:.1f} cm from the target at the end"
        shown.append(
            Recording(
                name=f"episode {index + 1}",
                fps=played.fps,
                root_pos=qpos[:, :3],
                root_quat=qpos[:, 3:7],
                joint_pos=qpos[:, 7:],
                target=target,
                latent=played.steering[index],
                contacts=played.contact[index],
                note=f"{_name(policy)}: {end}",
            )
        )
    return shown


def low_recordings(
    policy: Path, config: PlaybackConfig, seed: int, progress: Progress = SILENT
) -> list[Recording]:
    """What latents that nobody chose make of a low level, from a standing start.

    Raises:
        ArtifactError: The artifact holds no low level.
    """
    from lacoloco.pipelines.evaluation.rollout import record_low

    changing = config.latents == "random"
    chosen = int(config.latents) if config.latents and not changing else seed
    played = record_low(
        policy,
        seconds=config.seconds,
        episodes=config.episodes,
        seed=chosen,
        changing=changing,
        progress=progress,
    )
    shown = []
    for index, qpos in enumerate(played.qpos):
        way = np.linalg.norm(np.diff(qpos[:, :2], axis=0), axis=1).sum()
        end = "fell" if played.fell[index] else f"{way:.2f} m on its way"
        held = "changing latents" if changing else f"latent {index + 1} of seed {chosen}"
        shown.append(
            Recording(
                name=held if not changing else f"{held}, episode {index + 1}",
                fps=played.fps,
                root_pos=qpos[:, :3],
                root_quat=qpos[:, 3:7],
                joint_pos=qpos[:, 7:],
                latent=played.steering[index],
                contacts=played.contact[index],
                note=f"{_name(policy)}: {end}",
            )
        )
    return shown


def _name(policy: Path) -> str:
    """`run/stage/version`, or the name of a file that lies elsewhere, such as what comes with
    lacoloco.
    """
    return "/".join(policy.parts[-4:-1]) if policy.name == ARTIFACT else policy.stem


def chosen_clips(available: Sequence[Clip], count: int, names: Sequence[str]) -> list[int]:
    """Indices of the clips of these names, or of up to `count` of all, skill by skill in turn.

    Raises:
        StageError: A name that no clip has; the nearest is named.
    """
    index_of = {clip.name: index for index, clip in enumerate(available)}
    for name in names:
        if name not in index_of:
            near = get_close_matches(name, index_of, 1, cutoff=0.0)
            raise StageError(
                f"no clip '{name}' among {len(index_of)}; the nearest name is '{near[0]}'"
            )
    if names:
        return [index_of[name] for name in names]
    rank: dict[str, int] = {}
    turns = []
    for clip in available:
        rank[clip.skill] = rank.get(clip.skill, 0) + 1
        turns.append(rank[clip.skill])
    return sorted(range(len(available)), key=lambda index: (turns[index], index))[:count]
