"""What every stage takes and gives back: context, progress and result."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

from lacoloco.datasets.hashing import hash_file
from lacoloco.datasets.provenance import Parent
from lacoloco.datasets.robot_record import RobotRecord
from lacoloco.datasets.store import RunStore, StageDir
from lacoloco.datasets.work import Work


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

    def advance(self, done: int, **metrics: float) -> None:
        """Tell how much is done.

        Args:
            done: Amount done since `start`, absolute and in the unit of `total`.
            **metrics: Named metrics worth watching, e.g. `reward=0.71`.
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

    def advance(self, done: int, **metrics: float) -> None:
        """Ignore."""

    def say(self, line: str) -> None:
        """Ignore."""

    def stop(self) -> None:
        """Ignore."""


SILENT: Progress = Silent()


def track_steps(progress: Progress, description: str, total: int) -> Iterator[int]:
    """Count ``total`` steps of one part of the work, and tell after each how far it is."""
    progress.start(description, total)
    for step in range(total):
        yield step
        progress.advance(step + 1)
    progress.stop()


@dataclass(frozen=True)
class StageContext:
    """Where and how a stage runs; what it does is in its config and its inputs."""

    store: RunStore
    run: str
    seed: int = 0
    device: str = "cpu"
    """`"cpu"` (mujoco.batch) or `"cuda"` (MuJoCo Warp)."""
    resume: bool = False
    """Continue the newest unfinished version of the stage with the same work."""
    version: str = ""
    """With `resume`, the only version to continue, e.g. "0003"."""
    or_begin: bool = False
    """With `resume`, begin a version where none with the same work is unfinished."""
    checkpoint: Path | None = None
    """Begin a training where this checkpoint, perhaps of another machine, left off."""
    command: str = ""
    """The command line as typed; recorded in the artifact."""
    progress: Progress = SILENT

    def work(
        self,
        config: Any,
        robot: RobotRecord,
        inputs: Sequence[Path] | None = None,
        task: str = "",
    ) -> Work:
        """What a version of a stage is made from, in this context.

        Args:
            config: The stage's config, a dataclass, with every default resolved.
            robot: The robot.
            inputs: Artifacts that it is made from; None where the stage compares them itself.
            task: Text of a task file of the user's own.

        Raises:
            ArtifactError: An input is missing or cannot be read.
        """
        parents = None
        if inputs is not None:
            parents = tuple(Parent(str(path), hash_file(path)) for path in inputs)
        return Work(asdict(config), self.seed, robot, parents, task, self.command)

    def begin(self, stage: str, work: Work, label: str = "") -> StageDir:
        """Open the working directory of a stage: a new version, or the unfinished one.

        The run is the one used last from now on.

        Raises:
            ArtifactError: See `RunStore.begin`.
        """
        directory = self.store.begin(
            self.run,
            stage,
            work=work,
            label=label,
            resume=self.resume,
            version=self.version,
            or_begin=self.or_begin,
        )
        self.store.use(self.run)
        return directory


@dataclass(frozen=True)
class StageResult:
    """What a stage leaves behind."""

    artifact: Path
    """`artifact.h5` of the completed version."""
    metrics: dict[str, Any] = field(default_factory=dict)
    """Plain JSON values; what `--json` prints beside the path of the artifact."""
