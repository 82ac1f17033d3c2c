"""The error of this room."""

from __future__ import annotations


class RobotError(ValueError):
    """A robot that is unknown, incomplete or at odds with itself.

    The message is one line that names the robot, file or field and says what to do.
    """
