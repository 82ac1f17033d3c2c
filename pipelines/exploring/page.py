"""The live page: the robot, sliders for its latent, and what can be done to it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

import numpy as np

from lacoloco.pipelines.exploring.world import PUSH, ExploredWorld, rotated_to
from lacoloco.pipelines.viewing.extent import standing_extent
from lacoloco.pipelines.viewing.live_robot import WORLD, LiveRobot

if TYPE_CHECKING:
    import viser

SLIDER_STEP = 0.01
CAMERA = np.array([1.7, -2.2, 1.2])
"""Where the camera stands, in sizes of the robot."""
FRICTION = (0.05, 2.0)
FRICTION_STEP = 0.1
"""By which a key changes the friction."""


class Page:
    """Shows a world, and collects what a person asks of it.

    Whatever the browser sends waits in a queue until :meth:`obey`: the world is stepped by one
    thread, and what is asked is done between two steps.
    """

    def __init__(self, server: viser.ViserServer, world: ExploredWorld, title: str) -> None:
        """Build scene and controls."""
        self.server, self.world = server, world
        self._asked: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self.drawn: list[Callable[[], None]] = []
        """What else is to be shown after every step."""
        self.robot = LiveRobot(server, world.spec)
        extent = standing_extent(world.spec)
        server.initial_camera.position = tuple(CAMERA * extent.size)
        server.initial_camera.look_at = (0.0, 0.0, 0.9 * extent.top)
        server.scene.add_grid(f"{WORLD}/ground", infinite_grid=True, fade_distance=20.0)
        self.status = server.gui.add_markdown(f"**{title}**")
        self._title = title
        self._add_latent()
        self._add_actions()

    def obey(self) -> None:
        """Do what was asked since the last call."""
        while not self._asked.empty():
            self._asked.get()()

    @property
    def up_to_date(self) -> bool:
        """Whether nothing waits: until then, controls may be ahead of the world."""
        return self._asked.empty()

    def draw(self) -> None:
        """Show where the robot is."""
        with self.server.atomic():
            self.robot.place(self.world.qpos)
            for draw in self.drawn:
                draw()

    def tell(self, text: str) -> None:
        """Show a text in the panel, and the latent in force on the sliders."""
        self.status.content = f"**{self._title}**\n\n{text}"
        for slider, value in zip(self.sliders, self.world.latent, strict=True):
            if self.up_to_date and abs(slider.value - value) > SLIDER_STEP:
                slider.value = float(round(float(value), 2))

    def ask(self, what: Callable[[], None]) -> None:
        """Do something before the next step; may be called from any thread."""
        self._asked.put(what)

    def button(
        self, label: str, do: Callable[[], None], key: Any = None, color: Any = None
    ) -> None:
        """A button, and a key that does the same, in the folder that is open."""

        async def ask(_: object) -> None:
            self.ask(do)

        self.server.gui.add_button(label, color=color).on_click(ask)
        if key is not None:
            self.key(label, do, key)

    def key(self, label: str, do: Callable[[], None], key: Any) -> None:
        """A key without a button."""

        async def ask(_: object) -> None:
            self.ask(do)

        self.server.gui.add_command(label, hotkey=key).on_trigger(ask)

    def when_moved(self, control: Any, do: Callable[[Any], None]) -> None:
        """Call with the control's value when a person, and not this program, has changed it."""

        async def ask(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:
                value = event.target.value
                self.ask(lambda: do(value))

        control.on_update(ask)

    def _add_latent(self) -> None:
        gui = self.server.gui
        with gui.add_folder("Latent"):
            self.sliders: list[Any] = [
                gui.add_slider(f"z{index + 1}", -1.0, 1.0, SLIDER_STEP, round(float(value), 2))
                for index, value in enumerate(self.world.latent)
            ]
            for index, slider in enumerate(self.sliders):
                self.when_moved(slider, partial(self._turn, index))
            self.button("Random latent (N)", self.world.take_random, "N")

    def _add_actions(self) -> None:
        gui, world = self.server.gui, self.world
        with gui.add_folder("Robot"):
            self.button("Reset (R)", world.reset, "R")
            self.button("Push (P)", lambda: world.push(self.push.value), "P")
            self.push = gui.add_slider("push, m/s", 0.0, 3.0, 0.1, PUSH)
            self.friction: Any = gui.add_slider(
                "friction (F, G)", *FRICTION, 0.05, round(world.friction, 2)
            )
            self.when_moved(self.friction, world.set_friction)
            self.key("Less friction", lambda: self._add_friction(-FRICTION_STEP), "F")
            self.key("More friction", lambda: self._add_friction(FRICTION_STEP), "G")

    def _add_friction(self, more: float) -> None:
        low, high = FRICTION
        value = min(high, max(low, round(self.world.friction + more, 2)))
        self.world.set_friction(value)
        self.friction.value = value

    def _turn(self, index: int, value: float) -> None:
        self.world.take(rotated_to(self.world.latent, index, value))
