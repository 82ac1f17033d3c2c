"""Tasks are data: reward terms, constraints, command, resets and terminations by registered names.

A robot brings the tasks of the paper in its ``robot.toml``, one table each: ``walk`` and
``reach_in_place`` for the experts, ``imitate`` for the low level, ``reach`` for the high level. A
file of one's own holds one such table at its top level.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from lacoloco.pipelines.sim.commands import COMMANDS, Command, TargetCommand
from lacoloco.pipelines.sim.constraints import CONSTRAINTS, Constraint, own_limit
from lacoloco.pipelines.sim.disturbances.config import UNDISTURBED, Disturbances
from lacoloco.pipelines.sim.gait.clock import MEMORY
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.randomisation import Randomisation
from lacoloco.pipelines.sim.rewards import REWARDS, RewardTerm, parameters_of
from lacoloco.robots.errors import RobotError
from lacoloco.robots.loading import TOML
from lacoloco.robots.spec import RobotSpec
from lacoloco.robots.tables import (
    PI,
    Angle,
    Length,
    NonNegative,
    Place,
    Positive,
    Range,
    Rule,
    Share,
    nearest,
    parse_toml,
    read_table,
    read_value,
    refuse_unknown,
)

HalfTurn = Annotated[float, Rule("an angle in radians from 0 to pi", lambda x: 0 <= x <= PI)]


Seconds = Annotated[
    Range, Rule("two numbers of seconds from 0 to 10", lambda pair: pair[0] >= 0 and pair[1] <= 10)
]


@dataclass(frozen=True)
class ResetConfig:
    """How an episode starts: from the default pose with these spreads, or from a frame of a clip.

    Attributes:
        clip_share: Share of the episodes that start in a clip.
        gait_share: Share of the episodes of a task with a gait, told to walk, that start in it.
        position: Half-width of the square that it starts in [m].
        heading: Largest heading to either side [rad].
        lin_vel: Half-range of each component of the base's velocity [m/s].
        ang_vel: Half-range of each component of its turning [rad/s].
        joint_scale: Range of the factors on the default joint angles.
        stood_s: For how long the robot has stood there by itself [s]: a robot of one's own sags
            into its motors before a policy takes over. Those that would have fallen start sooner.
    """

    clip_share: Share = 0.0
    gait_share: Share = 0.0
    position: NonNegative = 0.0
    heading: HalfTurn = 3.14159
    lin_vel: NonNegative = 0.3
    ang_vel: NonNegative = 0.1
    joint_scale: Range = (0.9, 1.1)
    stood_s: Seconds = (0.0, 0.0)


@dataclass(frozen=True)
class Task:
    """One environment's rules.

    Attributes:
        name: What it is called.
        action_scale: Radians per unit of action.
        command: What is asked of the robot; None for nothing.
        episode_s: Seconds until the time-out.
        resample_s: Seconds between command changes inside an episode; None keeps one command.
        rewards: Terms; their weighted sum is multiplied by the control step, 0.02 s.
        clip_reward: Never pay less than zero.
        constraints: What must hold (Constraints as Terminations).
        fall_on_undesired: Also end the episode when an undesired body touches something.
        fall_tilt: End it also when the base is tilted by more than this [rad].
        fall_height: End it also when the base is lower than this [m].
        reset: How episodes start.
        randomisation: What differs between worlds.
        disturbances: What differs from the usual simulation.
        gait: Guided by the robot's gait: see :class:`lacoloco.pipelines.sim.gait.guide.GaitGuide`.
        memory: Outputs of a policy beyond the joints' actions, which it sees again with its last
            action: where an expert has a gait's clock, the low level keeps it in them.
        start_from: Task whose expert this one's begins as; "" for random networks.
        sample_factor: Factor on the samples that an expert is trained with: a harder task needs
            more.
        noise: Factor on the observation noise (0: clean).
        training_limits: Motors as strong as in training rather than as strong as they are.
    """

    name: str
    action_scale: float
    command: Command | None = None
    episode_s: float = 10.0
    resample_s: Range | None = None
    rewards: tuple[RewardTerm, ...] = ()
    clip_reward: bool = False
    constraints: tuple[Constraint, ...] = ()
    fall_on_undesired: bool = False
    fall_tilt: float | None = None
    fall_height: float | None = None
    reset: ResetConfig = field(default_factory=ResetConfig)
    randomisation: Randomisation = field(default_factory=Randomisation)
    disturbances: Disturbances = UNDISTURBED
    gait: bool = False
    memory: int = 0
    start_from: str = ""
    sample_factor: float = 1.0
    noise: float = 1.0
    training_limits: bool = True

    @property
    def episode_steps(self) -> int:
        """Control steps until the time-out."""
        return round(self.episode_s / CONTROL_DT)

    @property
    def has_target(self) -> bool:
        """Whether it asks the end effector to be somewhere."""
        return isinstance(self.command, TargetCommand)


@dataclass(frozen=True)
class _ConstraintRow:
    """One row of ``constraints``; without a limit, the robot's own holds."""

    name: str
    max_p: Share
    limit: float | None = None


@dataclass(frozen=True)
class _TaskTable:
    """A task as it is written; see :class:`Task`. ``action_scale`` is a name of ``[actions]``."""

    action_scale: str = "low"
    command: Mapping[str, Any] | None = None
    episode_s: Positive = 10.0
    resample_s: Range | None = None
    rewards: tuple[Mapping[str, Any], ...] = ()
    clip_reward: bool = False
    constraints: tuple[_ConstraintRow, ...] = ()
    fall_on_undesired: bool = False
    fall_tilt: Angle | None = None
    fall_height: Length | None = None
    reset: ResetConfig = field(default_factory=ResetConfig)
    randomisation: Randomisation = field(default_factory=Randomisation)
    disturbances: Disturbances = UNDISTURBED
    gait: bool = False
    start_from: str = ""
    sample_factor: Positive = 1.0


def load_task(spec: RobotSpec, name: str) -> Task:
    """The robot's task of that name.

    Raises:
        RobotError: There is none, or something in its table is wrong; one line that says what.
    """
    place = Place(str(spec.folder / TOML)) / "tasks"
    if name not in spec.tasks:
        place.fail(f"robot {spec.name!r} has no task {name!r}; {nearest(name, spec.tasks)}")
    return read_task(spec, name, spec.tasks[name], place / name)


def load_task_file(spec: RobotSpec, path: Path) -> Task:
    """A task from a file of one's own, called like the file.

    Raises:
        RobotError: It cannot be read, or something in it is wrong; one line that says what.
    """
    try:
        text = path.read_bytes().decode()
    except (OSError, UnicodeDecodeError) as error:
        raise RobotError(f"{path}: cannot be read as text: {error}") from error
    return task_from_text(spec, text, path)


def task_from_text(spec: RobotSpec, text: str, path: Path) -> Task:
    """The task in the text of a file that was called ``path``, and may be gone by now.

    Raises:
        RobotError: Something in it is wrong, or nothing is rewarded; one line that says what.
    """
    task = read_task(spec, path.stem, parse_toml(text, str(path)), Place(str(path)))
    if not task.rewards:
        (Place(str(path)) / "rewards").fail("missing; expected at least one reward term")
    return task


def read_task(spec: RobotSpec, name: str, values: object, place: Place) -> Task:
    """A task from its table.

    Raises:
        RobotError: One line that names the file, the key and what is expected.
    """
    table = read_table(_TaskTable, values, place)
    scales = {"low": spec.action_scale, "walk": spec.walk_action_scale}
    if table.action_scale not in scales:
        where = place / "action_scale"
        where.expected(f"one of {', '.join(scales)}", table.action_scale)
    return Task(
        name=name,
        action_scale=scales[table.action_scale],
        command=_command(table.command, place / "command"),
        episode_s=table.episode_s,
        resample_s=table.resample_s,
        rewards=tuple(
            _reward(row, place / "rewards" / i, table) for i, row in enumerate(table.rewards)
        ),
        clip_reward=table.clip_reward,
        constraints=tuple(
            _constraint(spec, row, place / "constraints" / i, table)
            for i, row in enumerate(table.constraints)
        ),
        fall_on_undesired=table.fall_on_undesired,
        fall_tilt=table.fall_tilt,
        fall_height=table.fall_height,
        reset=table.reset,
        randomisation=table.randomisation,
        disturbances=table.disturbances,
        gait=table.gait,
        memory=0 if table.gait or spec.gait is None else MEMORY,
        start_from=table.start_from,
        sample_factor=table.sample_factor,
    )


def imitate_task(spec: RobotSpec, *, constrained: bool) -> Task:
    """The low level's task, with or without its constraints."""
    task = load_task(spec, "imitate")
    return task if constrained else replace(task, constraints=())


def _command(values: Mapping[str, Any] | None, place: Place) -> Command | None:
    if values is None:
        return None
    kind = values.get("type")
    if not isinstance(kind, str) or kind not in COMMANDS:
        (place / "type").expected(f"one of {', '.join(COMMANDS)}", kind)
    rest = {key: value for key, value in values.items() if key != "type"}
    return read_table(COMMANDS[kind], rest, place)


def _reward(values: Mapping[str, Any], place: Place, table: _TaskTable) -> RewardTerm:
    name = values.get("name")
    if not isinstance(name, str) or name not in REWARDS:
        hint = nearest(name, REWARDS) if isinstance(name, str) else ", ".join(REWARDS)
        (place / "name").fail(f"{name!r} is no reward term; {hint}")
    if REWARDS[name].gait and not table.gait:
        (place / "name").fail(f"{name!r} needs a task with `gait = true`")
    _require_command(name, REWARDS[name].commands, table, place)
    parameters = parameters_of(name)
    refuse_unknown(values, ("name", "weight", *parameters), place)
    for key in ("weight", *(key for key, default in parameters.items() if default is None)):
        if key not in values:
            (place / key).fail("missing; expected a number")
    weight, *rest = (
        (key, read_value(float if key == "weight" else Positive, values[key], place / key))
        for key in ("weight", *parameters)
        if key in values
    )
    return RewardTerm(name, weight[1], tuple(rest))


def _constraint(
    spec: RobotSpec, row: _ConstraintRow, place: Place, table: _TaskTable
) -> Constraint:
    if row.name not in CONSTRAINTS:
        (place / "name").fail(f"{row.name!r} is no constraint; {nearest(row.name, CONSTRAINTS)}")
    _require_command(row.name, CONSTRAINTS[row.name].commands, table, place)
    limit = own_limit(spec, row.name) if row.limit is None else row.limit
    if limit is None:
        (place / "limit").fail("missing; expected a number")
    return Constraint(row.name, limit, row.max_p)


def _require_command(name: str, commands: tuple[str, ...], table: _TaskTable, place: Place) -> None:
    kind = None if table.command is None else table.command.get("type")
    if commands and kind not in commands:
        needed = " or ".join(map(repr, commands))
        (place / "name").fail(f"{name!r} needs a command of type {needed}")
