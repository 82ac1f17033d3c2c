"""A policy, live in the browser, until somebody ends it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Event

import numpy as np

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation.skill_cells import SkillCells
from lacoloco.pipelines.exploring.clip_names import ClipNames, clips_at_hand
from lacoloco.pipelines.exploring.latent_map import (
    SECONDS,
    Extreme,
    HeldLatents,
    extremes,
    hold_sampled,
)
from lacoloco.pipelines.exploring.live import run
from lacoloco.pipelines.exploring.map_board import MapBoard
from lacoloco.pipelines.exploring.page import Page
from lacoloco.pipelines.exploring.server import check_port, check_viser, local_server
from lacoloco.pipelines.exploring.target_handle import TargetHandle
from lacoloco.pipelines.exploring.world import ExploredWorld
from lacoloco.pipelines.policies import load_policies, task_of
from lacoloco.pipelines.robot import Say, robot_of
from lacoloco.pipelines.stage import Progress
from lacoloco.pipelines.viewing.thumbnails import draw_poses
from lacoloco.robots.spec import RobotSpec


@dataclass(frozen=True)
class ExploreConfig:
    """What is explored, and how.

    Attributes:
        policy: Artifact that holds a low level, and perhaps a high one.
        title: Its name on the page.
        motions: Clips that are named; default: those that the policy was made of.
        latents: How many are held for the map; 0: no map.
        seed: Of latents, pushes and targets.
        port: Of the page; 0: any that is free.
    """

    policy: Path
    title: str
    motions: Sequence[Path] = ()
    latents: int = 256
    seed: int = 0
    port: int = 0


def explore(
    config: ExploreConfig, progress: Progress, opened: Callable[[str], None]
) -> dict[str, str]:
    """Serve the page until Ctrl-C.

    Args:
        config: What.
        progress: Where the user is told what is done.
        opened: Told the address of the page.

    Returns:
        The robot and the address.

    Raises:
        StageError: viser is not installed, or the port is not to be had.
        ArtifactError: An input is missing or damaged, or there is no low level.
    """
    check_viser()
    check_port(config.port)
    artifact, policies = load_policies(config.policy, "low")
    spec = robot_of(artifact, progress.say)
    clips = clips_at_hand(config.policy, config.motions, spec.name)
    if not clips:
        progress.say("no clips of the policy at hand, so none is named; --motions names them")
    held = None
    found: list[tuple[Extreme, np.ndarray | None]] = []
    if config.latents:
        progress.say(f"holding {config.latents} latents for {SECONDS:.0f} s each, for the map")
        held = hold_sampled(spec, policies["low"], config.latents, config.seed, progress)
        found = with_pictures(spec, held, progress.say)
    task = task_of(artifact, spec) if "high" in policies else None
    world = ExploredWorld(policies, spec, task, seed=config.seed)
    with local_server(config.port) as server:
        page = Page(server, world, f"{config.title} ({spec.name})")
        if world.has_target:
            TargetHandle(page)
        if held is not None:
            MapBoard(page, held, found)
        address = f"http://{server.get_host()}:{server.get_port()}/"
        opened(address)
        with suppress(KeyboardInterrupt):
            run(world, page, Event(), ClipNames(clips) if clips else None)
    return {"robot": spec.name, "address": address}


def with_pictures(
    spec: RobotSpec, held: HeldLatents, say: Say
) -> list[tuple[Extreme, np.ndarray | None]]:
    """What held latents do most, each with a picture of how it ends.

    Without OpenGL there is none, and ``say`` is told why.
    """
    found = extremes(held, SkillCells.of(spec))
    if not found:
        return []
    try:
        pictures = draw_poses(spec, held.poses[[extreme.index for extreme in found]])
    except StageError as error:
        say(f"no pictures of what latents do: {error}")
        return [(extreme, None) for extreme in found]
    return list(zip(found, pictures, strict=True))
