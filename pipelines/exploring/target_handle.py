"""The high level's target in the scene, with arrows to drag it by."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lacoloco.pipelines.exploring.page import Page
from lacoloco.pipelines.viewing.extent import standing_extent
from lacoloco.pipelines.viewing.live_robot import WORLD

if TYPE_CHECKING:
    import viser

TARGET = f"{WORLD}/target"
ARROWS = 0.5
"""Length of the arrows, in sizes of the robot."""
BALL = 0.06
"""Radius of the ball, in sizes of the robot."""
COLOUR = (255, 40, 60)


class TargetHandle:
    """A ball where the end effector is asked to be, and a switch for the high level.

    Attributes:
        arrows: What is dragged.
        switch: Whether the high level steers; a latent that is taken by hand turns it off.
    """

    def __init__(self, page: Page) -> None:
        """Show the target of the page's world, which has one."""
        self._page, self._world = page, page.world
        size = standing_extent(page.world.spec).size
        self.arrows = page.server.scene.add_transform_controls(
            TARGET, scale=ARROWS * size, disable_rotations=True, position=page.world.target
        )
        page.server.scene.add_icosphere(f"{TARGET}/ball", radius=BALL * size, color=COLOUR)
        with page.server.gui.add_folder("Target"):
            self.switch: Any = page.server.gui.add_checkbox("high level steers", True)

        async def moved(event: viser.TransformControlsEvent) -> None:
            place = np.array(event.target.position)
            page.ask(lambda: page.world.set_target(place))

        self.arrows.on_update(moved)
        page.when_moved(self.switch, self._steer)
        page.drawn.append(self._draw)

    def _steer(self, steers: bool) -> None:
        self._world.high_steers = steers

    def _draw(self) -> None:
        if self._page.up_to_date and self.switch.value != self._world.high_steers:
            self.switch.value = self._world.high_steers
