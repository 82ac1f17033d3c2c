"""The OpenGL that draws without a window.

MuJoCo takes the kind of OpenGL from $MUJOCO_GL when it is first imported, and a window's if that is
not set; here it is chosen when the first picture is drawn. MuJoCo is imported late: with a
$MUJOCO_GL that is not installed the import itself fails.
"""

from __future__ import annotations

import os
import platform
from ctypes.util import find_library
from typing import Any

from lacoloco.pipelines.errors import StageError

CHOICES = ("egl", "osmesa")
"""What draws without a window on Linux."""
LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}
"""The library of each of them, as the linker calls it."""
PACKAGES = {"egl": "libegl1 libgl1 libgl1-mesa-dri", "osmesa": "libosmesa6"}
"""Names on Debian and Ubuntu of the packages that bring each of them."""


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
        raise StageError(missing(error)) from error
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
    """What $MUJOCO_GL asks for, if it draws without a window; else the first that is installed.

    EGL draws on a GPU, and in software where there is none; OSMesa only in software.
    """
    asked = os.environ.get("MUJOCO_GL", "").strip().lower()
    if asked in CHOICES:
        return asked
    return next((one for one in CHOICES if find_library(LIBRARIES[one])), CHOICES[0])


def missing(error: Exception) -> str:
    """One line that says what to install."""
    if platform.system() != "Linux":
        return f"cannot draw pictures, OpenGL is missing here ({error})"
    wanted = _wanted()
    (other,) = set(CHOICES) - {wanted}
    return (
        f"cannot draw pictures without OpenGL (MUJOCO_GL={wanted} does not work here); install it"
        f" (on Debian and Ubuntu: apt install {PACKAGES[wanted]}), or set MUJOCO_GL={other} (apt"
        f" install {PACKAGES[other]})"
    )
