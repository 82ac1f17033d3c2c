"""The loop of the live page: 50 control steps a second, for as long as somebody looks."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from threading import Event

import numpy as np

from lacoloco.pipelines.exploring.clip_names import ClipNames
from lacoloco.pipelines.exploring.page import Page
from lacoloco.pipelines.exploring.world import ExploredWorld
from lacoloco.pipelines.sim.physics import CONTROL_DT

TOLD_EVERY = 10
"""Control steps between two texts."""
BEHIND = 0.2
"""s by which a slow machine may fall behind before it goes on slower instead of catching up."""
LYING_S = 1.0
"""s for which a robot that fell lies there before it is stood up."""


class Pace:
    """When the next step is due, and how many there are a second.

    Attributes:
        rate: Steps a second, over the last one.
    """

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """The first step is due now."""
        self._clock, self._sleep = clock, sleep
        self._due, self._times = clock(), deque[float](maxlen=round(1.0 / CONTROL_DT) + 1)

    @property
    def rate(self) -> float:
        """Steps a second, over the last one; 0 while unknown."""
        if len(self._times) < 2 or self._times[-1] == self._times[0]:
            return 0.0
        return (len(self._times) - 1) / (self._times[-1] - self._times[0])

    def wait(self) -> None:
        """Sleep until the next step is due."""
        self._due += CONTROL_DT
        ahead = self._due - self._clock()
        if ahead > 0.0:
            self._sleep(ahead)
        elif ahead < -BEHIND:
            self._due = self._clock()
        self._times.append(self._clock())


def run(world: ExploredWorld, page: Page, stop: Event, clips: ClipNames | None = None) -> None:
    """Step and show the world until told to stop; it rests while nobody looks.

    Args:
        world: What is stepped.
        page: Where it is shown.
        stop: Set to end it.
        clips: Of which the nearest is named.
    """
    pace, recent, lying = Pace(), deque[np.ndarray](maxlen=round(1.0 / CONTROL_DT)), 0
    number = 0
    while not stop.is_set():
        page.obey()
        if not page.server.get_clients():
            stop.wait(0.1)
            pace = Pace()
            continue
        world.step()
        page.draw()
        recent.append(world.frame.numpy())
        lying = lying + 1 if world.fell else 0
        if lying * CONTROL_DT > LYING_S:
            world.reset()
        if number % TOLD_EVERY == 0:
            page.tell(status_text(world, np.stack(recent), pace.rate, clips))
        number += 1
        pace.wait()


def status_text(
    world: ExploredWorld, frames: np.ndarray, rate: float, clips: ClipNames | None = None
) -> str:
    """What the robot does, in a few lines.

    Args:
        world: The robot now.
        frames: (T, 10 + 2J) its style frames in the last second.
        rate: Control steps a second.
        clips: Of which the nearest is named.
    """
    mean = frames.mean(axis=0)
    forward, left, turning = float(mean[4]), float(mean[5]), float(mean[9])
    lines = [
        f"forward {forward:+.2f} m/s, left {left:+.2f} m/s, turning {turning:+.2f} rad/s",
        f"end effector {world.end_effector_height:.2f} m up, friction {world.friction:.2f}",
    ]
    if world.has_target:
        lines[-1] += f", {100 * world.target_error:.1f} cm from the target"
    if clips is not None:
        lines.append(f"nearest clip: {clips.nearest(frames)}")
    lines.append(f"{rate:.0f} steps/s" + (", **fell**" if world.fell else ""))
    return "  \n".join(lines)
