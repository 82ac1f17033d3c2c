"""Pictures that MuJoCo draws without a window."""

from __future__ import annotations

from types import TracebackType

import mujoco
import numpy as np

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.viewing.opengl import missing, open_gl

MAX_GEOMS = 1000


class Painter:
    """Draws one model; a context that holds OpenGL."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        """Make room for pictures of this size, pixels.

        Raises:
            StageError: There is no OpenGL here; the message says how to get it.
        """
        self._model = model
        self._gl = open_gl(width, height)
        self._view = mujoco.MjrRect(0, 0, width, height)
        self._option = mujoco.MjvOption()
        self._scene = mujoco.MjvScene(model, MAX_GEOMS)
        try:
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        except mujoco.FatalError as error:
            self._gl.free()
            raise StageError(missing(error)) from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)

    def __enter__(self) -> Painter:
        """Give itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give OpenGL back."""
        self._context.free()
        self._gl.free()

    def draw(self, data: mujoco.MjData, camera: mujoco.MjvCamera) -> np.ndarray:
        """One picture, (height, width, 3) uint8 RGB, of a state whose kinematics are computed."""
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(
            self._model, data, self._option, None, camera, everything, self._scene
        )
        mujoco.mjr_render(self._view, self._scene, self._context)
        upside_down = np.empty((self._view.height, self._view.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(upside_down, None, self._view, self._context)
        return upside_down[::-1]
