"""The robot of an artifact: which one it is, and the texts that describe it."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping
from typing import Any, NamedTuple

NO_MATTER = ("retargeting", "hindsight")
"""Of a ``robot.toml``: how recordings become motions, and a table of before that nothing reads."""


class RobotRecord(NamedTuple):
    """What an artifact keeps of its robot, so that it can be used where the robot's folder is gone.

    Attributes:
        name: Name of the robot.
        model_hash: SHA-256 of its MJCF, hexadecimal.
        files: Name of a file in the robot's folder -> its text; empty in artifacts of before.
        folder: Where the folder lay; "" for a robot that comes with lacoloco.
    """

    name: str
    model_hash: str
    files: Mapping[str, str] = {}
    folder: str = ""

    @property
    def digest(self) -> str:
        """SHA-256 over all that is known of the robot: equal for equal robots, whatever the folder.

        Without texts it is the hash of the MJCF alone.
        """
        if not self.files:
            return self.model_hash
        digest = hashlib.sha256(self.name.encode())
        for name in sorted(self.files):
            digest.update(f"\0{name}\0{self.files[name]}".encode())
        return digest.hexdigest()

    def agrees_with(self, other: RobotRecord) -> bool:
        """Whether both are one robot, as far as both say; an artifact of before says less."""
        if (self.name, self.model_hash) != (other.name, other.model_hash):
            return False
        return not (self.files and other.files) or _meant(self.files) == _meant(other.files)


def _meant(files: Mapping[str, str]) -> dict[str, Any]:
    """What the texts say of the robot itself: not their comments, nor what is no matter to a motion
    or a policy that is made.
    """
    return {name: _tables(text) if name.endswith(".toml") else text for name, text in files.items()}


def _tables(text: str) -> Any:
    try:
        tables = tomllib.loads(text)
    except ValueError:  # of a form that only an older lacoloco reads
        return text
    return {key: value for key, value in tables.items() if key not in NO_MATTER}
