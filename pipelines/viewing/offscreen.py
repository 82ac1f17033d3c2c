"""Pictures that MuJoCo draws without a window.

MuJoCo's own `Renderer` takes the kind of OpenGL from the environment when it is first imported, and
then a window's if nothing is set; here it is chosen when the first picture is drawn.
"""

from __future__ import annotations

import os
import platform
from types import TracebackType
from typing import Any

import mujoco
import numpy as np

from lacoloco.pipelines.errors import StageError

CHOICES = ("egl", "osmesa")
"""What draws without a window on Linux."""
PACKAGES = {"egl": "libegl1 libgl1 libgl1-mesa-dri", "osmesa": "libosmesa6"}
"""Names on Debian and Ubuntu of the packages that bring each of them."""
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
            raise StageError(_missing(error)) from error
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


def check_gl() -> None:
    """See whether pictures can be drawn here at all, before the work rather than after it.

    Raises:
        StageError: They cannot; the message says what to install.
    """
    open_gl(16, 16).free()


def open_gl(width: int, height: int) -> Any:
    """An OpenGL context of this size, pixels, in use from now on; its `free` ends it.

    Raises:
        StageError: There is none here; the message says what to install.
    """
    try:
        context = _context_class()(width, height)
        context.make_current()
    except Exception as error:  # missing libraries show as errors of half a dozen types
        raise StageError(_missing(error)) from error
    return context


def _context_class() -> type[Any]:
    if platform.system() != "Linux":
        from mujoco.gl_context import GLContext  # of the system itself, no window either
    elif _wanted() == "osmesa":
        from mujoco.osmesa import GLContext
    else:
        from mujoco.egl import GLContext
    return GLContext


def _wanted() -> str:
    """What $MUJOCO_GL asks for, if it draws without a window; else egl."""
    asked = os.environ.get("MUJOCO_GL", "").strip().lower()
    return asked if asked in CHOICES else "egl"


def _missing(error: Exception) -> str:
    if platform.system() != "Linux":
        return f"cannot draw pictures, OpenGL is missing here ({error})"
    wanted = _wanted()
    (other,) = set(CHOICES) - {wanted}
    return (
        f"cannot draw pictures without OpenGL (MUJOCO_GL={wanted} does not work here); install it"
        f" (on Debian and Ubuntu: apt install {PACKAGES[wanted]}), or set MUJOCO_GL={other} (apt"
        f" install {PACKAGES[other]})"
    )
