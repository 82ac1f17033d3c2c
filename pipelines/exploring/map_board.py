"""The map of the latent sphere as a board in the scene: click to take a latent, drag to wander."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from lacoloco.datasets import rotations
from lacoloco.pipelines.evaluation.skill_cells import LIFT, YAW
from lacoloco.pipelines.exploring.latent_map import (
    SECONDS,
    Extreme,
    HeldLatents,
    LatentMap,
)
from lacoloco.pipelines.exploring.page import CAMERA, Page
from lacoloco.pipelines.viewing.extent import standing_extent

if TYPE_CHECKING:
    import viser

BOARD = "/map"
RADIUS = 0.75
"""Of the disc, in sizes of the robot."""
BEHIND = 0.8
"""How far behind the robot it stands, as the camera sees it, in sizes of the robot."""
NEAR = 0.06
"""A click so near to a held latent, in radii of the disc, takes that very latent."""
LIFTED = 0.02
"""How far before the disc the points lie, in its radii."""
FELL = (120, 120, 120)
COLOURS = ("speed", "turning", "reaching")


class MapBoard:
    """A disc behind the robot, a point for every held latent, a ball at the one in force.

    Attributes:
        map: What it shows.
    """

    def __init__(
        self, page: Page, held: HeldLatents, found: Sequence[tuple[Extreme, np.ndarray | None]]
    ) -> None:
        """Put up the board, and the list of what is reached most.

        Args:
            page: Where.
            held: What is on the map.
            found: What is in the list, each with its picture (height, width, 3) uint8, if there is
                one.
        """
        import trimesh

        self._page, self._held, self.map = page, held, LatentMap(held)
        extent = standing_extent(page.world.spec)
        self._radius = RADIUS * extent.size
        away = np.array([CAMERA[0], CAMERA[1], 0.0]) / np.hypot(CAMERA[0], CAMERA[1])
        height = extent.top + 1.15 * self._radius
        self._centre = -BEHIND * extent.size * away + np.array([0.0, 0.0, height])
        up = np.array([0.0, 0.0, 1.0])
        self._turn = np.stack([np.cross(up, away), up, away], axis=1)
        """(3, 3) board to world: its x axis to the right, y up, z towards the camera."""
        scene = page.server.scene
        scene.add_frame(
            BOARD, show_axes=False, position=self._centre, wxyz=rotations.from_matrix(self._turn)
        )
        disc = trimesh.creation.cylinder(radius=1.02 * self._radius, height=1e-3, sections=64)
        self.disc = scene.add_mesh_simple(
            f"{BOARD}/disc", disc.vertices, disc.faces, color=(28, 34, 44), cast_shadow=False
        )
        self.points = scene.add_point_cloud(
            f"{BOARD}/points",
            self._on_board(self.map.points),
            self._colours(COLOURS[0]),
            point_size=0.04 * self._radius,
            point_shape="circle",
            precision="float32",
        )
        self.marker = scene.add_icosphere(
            f"{BOARD}/marker", radius=0.04 * self._radius, color=(255, 40, 60)
        )
        self._listen()
        page.drawn.append(self.draw)
        self._add_panel(found)

    def draw(self) -> None:
        """Show where the latent in force lies."""
        place = self.map.place(self._page.world.latent)
        self.marker.position = self._on_board(place[None])[0]

    def take_at(self, origin: np.ndarray, through: np.ndarray, *, snap: bool) -> None:
        """Take the latent where a ray meets the board; nothing where it does not.

        Args:
            origin: (3,) where the ray begins [m].
            through: (3,) its direction.
            snap: Whether the held latent nearby is taken, if there is one.
        """
        point = self._point(origin, through)
        if point is None:
            return
        index = self.map.nearest(point, NEAR) if snap else None
        world = self._page.world
        latents = self._held.latents
        world.take(self.map.latent_at(point, world.latent) if index is None else latents[index])

    def place_in_scene(self, points: np.ndarray) -> np.ndarray:
        """(n, 2) points of the map -> (n, 3) in the scene [m], of which the robot is the middle."""
        placed: np.ndarray = self._centre + self._on_board(points) @ self._turn.T
        return placed

    def _point(self, origin: np.ndarray, through: np.ndarray) -> np.ndarray | None:
        """(2,) point of the disc, in its radii, that a ray meets."""
        normal = self._turn[:, 2]
        toward = float(through @ normal)
        if abs(toward) < 1e-9:
            return None
        hit = origin + through * float((self._centre - origin) @ normal) / toward
        met: np.ndarray = (self._turn.T @ (hit - self._centre))[:2] / self._radius
        return met

    def _on_board(self, points: np.ndarray) -> np.ndarray:
        """(n, 2) points of the disc -> (n, 3) in the board's frame [m]."""
        before = np.full((len(points), 1), LIFTED)
        return np.concatenate((points, before), axis=1) * self._radius

    def _listen(self) -> None:
        async def clicked(event: viser.SceneNodePointerEvent[viser.MeshHandle]) -> None:
            origin, through = np.array(event.ray_origin), np.array(event.ray_direction)
            self._page.ask(lambda: self.take_at(origin, through, snap=True))

        async def dragged(event: viser.SceneNodeDragEvent[viser.MeshHandle]) -> None:
            # What the event tells lies in a plane that faces the camera, not on the board.
            origin = np.array(event.client.camera.position)
            through = np.array(event.end_position) - origin
            self._page.ask(lambda: self.take_at(origin, through, snap=False))

        self.disc.on_click(clicked)
        self.disc.on_drag("left")(dragged)

    def _show(self, latent: np.ndarray) -> None:
        """Take a latent from a standing start, as it was measured: in other states it may do
        something else, such as going on to reach.
        """
        self._page.world.reset()
        self._page.world.take(latent)

    def _colours(self, by: str) -> np.ndarray:
        """(N, 3) of the points, 0 to 255."""
        import matplotlib

        held = self._held
        values = {
            "speed": held.speed,
            "turning": held.motion[:, YAW],
            "reaching": held.motion[:, LIFT],
        }[by]
        upright = values[~held.fell] if (~held.fell).any() else values
        low, high = float(upright.min()), float(upright.max())
        if by == "turning":
            high = max(abs(low), abs(high))
            low = -high
        share = np.clip((values - low) / max(high - low, 1e-6), 0.0, 1.0)
        table = matplotlib.colormaps["coolwarm" if by == "turning" else "viridis"]
        colours: np.ndarray = np.round(255.0 * table(share)[:, :3]).astype(np.uint8)
        colours[held.fell] = FELL
        return colours

    def _add_panel(self, found: Sequence[tuple[Extreme, np.ndarray | None]]) -> None:
        gui = self._page.server.gui
        with gui.add_folder("Map of held latents"):
            colour = gui.add_dropdown("colour", COLOURS)
            for extreme, picture in found:
                latent = self._held.latents[extreme.index]
                if picture is not None:
                    gui.add_image(picture, format="jpeg")
                label = f"{extreme.name}: {extreme.value:+.2f} {extreme.unit}"
                self._page.button(label, partial(self._show, latent), color="gray")
            gui.add_markdown(legend(self._held))

        async def recolour(_: object) -> None:
            self.points.colors = self._colours(colour.value)

        colour.on_update(recolour)


def legend(held: HeldLatents) -> str:
    """How the map is used, what its colours mean, and what share of the latents does what."""
    upright = held.motion[~held.fell] if (~held.fell).any() else held.motion
    turning, lift = np.abs(upright[:, YAW]).max(), upright[:, LIFT].max()
    shares = ", ".join(f"{share:.0%} {name}" for name, share in held.shares.items())
    return (
        "The buttons begin anew from standing. Click a point to take its latent now, drag over the"
        " map to wander; the red ball is the latent in force."
        f" Points are {len(held.latents)} latents, each held for {SECONDS:.0f} s:"
        f" {shares}. Dark to light: speed, up to {held.speed.max():.2f} m/s, or the end effector,"
        f" up to {lift:.2f} m above standing. Blue to red: turning right to left, up to"
        f" {turning:.2f} rad/s. Grey fell."
    )
