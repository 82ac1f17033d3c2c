"""The robot that an artifact belongs to: what is kept of it, and how it is found again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from lacoloco.datasets.artifact import Header, read_header
from lacoloco.datasets.robot_record import RobotRecord
from lacoloco.pipelines.errors import StageError
from lacoloco.robots.errors import RobotError
from lacoloco.robots.loading import load_folder, robot_from_files
from lacoloco.robots.registry import is_bundled, load_robot, robot_folders
from lacoloco.robots.spec import RobotSpec

Say = Callable[[str], None]
"""Takes one line for the user."""


def record_of(spec: RobotSpec) -> RobotRecord:
    """What an artifact keeps of its robot."""
    # Where lacoloco is installed differs from machine to machine and says nothing about the robot.
    folder = "" if is_bundled(spec) else str(spec.folder.absolute())
    return RobotRecord(spec.name, spec.model_hash(), spec.files(), folder)


def robot_of(header: Header, say: Say | None = None) -> RobotSpec:
    """The robot that an artifact was made with.

    Its own folder, or else the robot known by its name, is taken when the files there still say
    what those of the artifact do. Otherwise the texts that the artifact carries are taken; such a
    robot has no meshes to look at. An artifact of before carries none: there its name decides.

    Args:
        header: The artifact.
        say: Told in one line when the artifact's own texts are used.

    Raises:
        RobotError: The artifact belongs to no robot, or its robot is not to be found or read.
    """
    if not header.robot:
        raise RobotError(f"{header.path}: belongs to no robot; name another artifact")
    record = header.robot_record
    if not record.files:
        return load_robot(record.name)
    known = list(_known(record))
    for spec in known:
        if record_of(spec).agrees_with(record):
            return spec
    try:
        spec = robot_from_files(record.files, Path(record.folder) if record.folder else None)
    except RobotError as error:
        return _same_model(known, record, header.path, error)
    if say is not None:
        where = record.folder or f"lacoloco's {record.name}"
        changed = f"{where} has changed since" if known else f"{where} is not there"
        say(f"robot {record.name}: {changed}; taking the files that {header.path} carries")
    return spec


def robot_of_all(motions: Iterable[Path], say: Say | None = None) -> RobotSpec:
    """The one robot that several artifacts of motions belong to.

    Raises:
        StageError: No motions, several robots, or several versions of one.
        RobotError: See :func:`robot_of`.
        ArtifactError: An artifact is missing or damaged.
    """
    headers = [read_header(path) for path in motions]
    names = sorted({header.robot for header in headers})
    if len(names) != 1:
        raise StageError(
            f"motions of exactly one robot are needed, found: {', '.join(names) or 'none'}; name"
            " them with --motions"
        )
    # The one that says most: artifacts of before know only the name and the hash of the MJCF.
    first = max(headers, key=lambda header: bool(header.robot_files))
    for header in headers:
        if not header.robot_record.agrees_with(first.robot_record):
            raise StageError(
                f"{first.path} and {header.path}: made with different versions of robot"
                f" '{first.robot}'; make both with one, or give one of them another name"
            )
    return robot_of(first, say)


def belongs_to(header: Header, spec: RobotSpec) -> bool:
    """Whether an artifact was made with just this robot, as far as it says."""
    return header.robot_record.agrees_with(record_of(spec))


def _known(record: RobotRecord) -> Iterator[RobotSpec]:
    """The robots in the recorded folder and of that name in the registry, if they can be read."""
    registered = robot_folders().get(record.name)
    for folder in (Path(record.folder) if record.folder else None, registered):
        if folder is not None:
            with suppress(RobotError):  # what cannot be read is of no use; the artifact has its own
                yield load_folder(folder)


def _same_model(
    known: list[RobotSpec], record: RobotRecord, path: Path, error: RobotError
) -> RobotSpec:
    """The known robot with the same MJCF, where the carried robot.toml is of an older form.

    Raises:
        RobotError: There is none.
    """
    for spec in known:
        if (spec.name, spec.model_hash()) == (record.name, record.model_hash):
            return spec
    raise RobotError(f"{path}: the robot that it carries cannot be used: {error}") from error
