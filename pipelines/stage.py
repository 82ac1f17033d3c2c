"""What every stage takes and gives back: context, progress and result."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from lacoloco.datasets.store import RunStore


class Progress(Protocol):
    """Where a stage tells how far it is; the command line turns it into a bar or plain lines.

    A stage may `start` again after `stop`, once per part of its work.
    """

    def start(self, description: str, total: int) -> None:
        """Begin a part of the work.

        Args:
            description: Names the part, e.g. `"train-low seed 0"`.
            total: Amount of work in the part's own unit (samples, frames, episodes); 0 if unknown.
        """
        ...

    def advance(self, done: int, **figures: float) -> None:
        """Tell how much is done.

        Args:
            done: Amount done since `start`, absolute and in the unit of `total`.
            **figures: Named figures worth watching, e.g. `reward=0.71`.
        """
        ...

    def say(self, line: str) -> None:
        """Print one line that stays, e.g. that experts are trained because the run has none."""
        ...

    def stop(self) -> None:
        """End the part; harmless when none was started."""
        ...


class Silent:
    """A `Progress` that shows nothing."""

    def start(self, description: str, total: int) -> None:
        """Ignore."""

    def advance(self, done: int, **figures: float) -> None:
        """Ignore."""

    def say(self, line: str) -> None:
        """Ignore."""

    def stop(self) -> None:
        """Ignore."""


SILENT: Progress = Silent()


@dataclass(frozen=True)
class StageContext:
    """Where and how a stage runs; what it does is in its config and its inputs."""

    store: RunStore
    run: str
    seed: int = 0
    device: str = "cpu"
    """`"cpu"` (mujoco.batch) or `"cuda"` (MuJoCo Warp)."""
    resume: bool = False
    """Continue the newest unfinished version of the stage."""
    checkpoint: Path | None = None
    """Begin a training where this checkpoint, perhaps of another machine, left off."""
    command: str = ""
    """The command line as typed; recorded in the artifact."""
    progress: Progress = SILENT


@dataclass(frozen=True)
class StageResult:
    """What a stage leaves behind."""

    artifact: Path
    """`artifact.h5` of the completed version."""
    metrics: dict[str, Any] = field(default_factory=dict)
    """Plain JSON values; what `--json` prints beside the path of the artifact."""
