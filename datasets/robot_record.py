"""The robot of an artifact: which one it is, and the texts that describe it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import NamedTuple


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
        return not (self.files and other.files) or self.files == other.files
