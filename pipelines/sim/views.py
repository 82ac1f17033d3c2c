"""What policies and critics see of an environment's worlds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import torch

from lacoloco.pipelines.sim.observation import Observation, is_recorded, observed_terms
from lacoloco.pipelines.sim.readings import Readings
from lacoloco.pipelines.sim.state import Term, style_frame, width

if TYPE_CHECKING:
    from lacoloco.pipelines.sim.env import LeggedEnv


class View:
    """What one policy sees of an environment's worlds, column by column of its layout.

    Attributes:
        terms: The layout.
        observation: What the policy observes.
        columns: (width,) which columns of the readings, one behind the other, and what is behind
            them.
    """

    def __init__(self, env: LeggedEnv, all_terms: Sequence[Term], observation: Observation) -> None:
        """See what the observation allows.

        Args:
            env: The worlds; they keep readings from now on.
            all_terms: Layout of a policy that observes everything now.
            observation: What this one observes.
        """
        self.terms = observed_terms(all_terms, observation)
        self._env, self.observation = env, observation
        self._readings = _kept_readings(env, observation.history)
        columns = columns_of(self.terms, recorded_terms(env), observation.history)
        self.columns = torch.tensor(columns, device=env.device)

    def __call__(self, *further: torch.Tensor) -> torch.Tensor:
        """(N, width of ``terms``); ``further`` are terms that the environment does not know, such
        as the last latent, in their order.
        """
        readings = self._readings.record.latest(self.observation.history)
        asked = _command(self._env, by_odometry=self.observation.onboard)
        return torch.cat((readings, *asked, *further), dim=-1)[:, self.columns]


def columns_of(terms: Sequence[Term], recorded: Sequence[Term], history: int) -> list[int]:
    """Columns of a layout in ``history`` readings of ``recorded`` terms, one behind the other, with
    the layout's further terms behind them.
    """
    first, start = {}, 0
    for term in recorded:
        first[term.name] = start
        start += term.size
    columns, behind = list[int](), start * history
    for term in terms:
        if is_recorded(term):
            begin = term.steps_ago * start + first[term.name]
        else:
            begin, behind = behind, behind + term.size
        columns += range(begin, begin + term.size)
    return columns


def look(env: LeggedEnv) -> torch.Tensor:
    """(N, width) all that policies may see of now, with other noise at every look."""
    clean = torch.cat((style_frame(env.seen()), env.action, *_command(env)), dim=-1)
    if env.task.noise != 0.0:
        uniform = torch.rand(clean.shape, generator=env.generator, device=env.device)
        clean = clean + (uniform * 2.0 - 1.0) * (env.noise_scale * env.noise)
    clean = clean if env.sensors is None else env.sensors.look(clean)
    return clean if env.guide is None else env.guide.observe(clean)


def reading(env: LeggedEnv) -> torch.Tensor:
    """(N, W) the part of a look that is recorded; see :func:`recorded_terms`."""
    return look(env)[:, : width(recorded_terms(env))]


def recorded_terms(env: LeggedEnv) -> tuple[Term, ...]:
    """Layout of one reading."""
    return tuple(term for term in env.all_terms if is_recorded(term))


def privileged(env: LeggedEnv) -> torch.Tensor:
    """(N, P) what a critic may know: clean style frame, the parameters of each world (see
    :class:`~lacoloco.pipelines.sim.physics.WorldParameters`), the command from the true state.
    """
    parts = [env.frame(), *env.parameters.columns().values()]
    if env.task.command is not None:
        parts.append(env.task.command.observe(env.command, env.state))
    return torch.cat([part.view(env.num_worlds, -1) for part in parts], dim=-1)


def _command(env: LeggedEnv, *, by_odometry: bool = False) -> tuple[torch.Tensor, ...]:
    """(N, size of its term) the command as the robot sees it; nothing where nothing is asked."""
    if env.task.command is None:
        return ()
    seen = env.seen()
    if by_odometry:
        assert env.readings is not None
        seen = env.readings.odometry.reading(env.seen(on_board=True))
    return (env.task.command.observe(env.command, seen),)


def _kept_readings(env: LeggedEnv, history: int) -> Readings:
    """The readings of the environment, which keeps at least so many from now on."""
    assert env.guide is None, "a gait's view is mirrored in half of its cycle"
    if env.readings is None:
        seen = env.seen(on_board=True)
        env.readings = Readings(reading(env), seen, env.spec.odometry, env.seed)
    env.readings.record.extend(history)
    return env.readings
