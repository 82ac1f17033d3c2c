"""What the experts would do where the cloned policy goes by itself (DAgger; Ross, Gordon and
Bagnell, "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online Learning",
2011).

A policy cloned from clips has only seen the states of the clips. A small error takes it to others,
where nothing pulls it back: a walker on two legs falls. The experts performed the clips on command,
so they can be asked again, wherever the policy is by now. No clip shows how one skill turns into
another; there, too, an expert knows how to stay up.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.generation.recorder import SKILLS
from lacoloco.pipelines.low_level.expert_worlds import (
    ExpertWorlds,
    LabelledStates,
    Student,
    WatchedClips,
    resting_rows,
)
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.sim.clip_actions import ClipStates
from lacoloco.pipelines.sim.commands import VelocityCommand
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.robots.spec import RobotSpec


class ExpertLabels:
    """Worlds for every expert whose clips are in a library."""

    def __init__(
        self,
        spec: RobotSpec,
        library: MotionLibrary,
        states: ClipStates,
        experts: Mapping[str, Policy],
        *,
        worlds: int,
        hold_steps: int,
        seed: int,
        shifted: bool = False,
    ) -> None:
        """Build ``worlds`` worlds for each of the ``experts``, task -> policy; the latent of one
        moment is held for at most ``hold_steps`` control steps. ``shifted`` worlds differ by the
        hardware shift.

        Raises:
            StageError: No clip says what an expert was commanded.
        """
        commands = _commands(library, states)
        self.experts = {
            name: ExpertWorlds(
                spec,
                name,
                experts[name],
                states,
                _watched_clips(spec, name, skill, library, states, commands),
                worlds=worlds,
                hold_steps=hold_steps,
                seed=seed,
                shifted=shifted,
            )
            for name, skill in SKILLS.items()
            if name in experts and _known(library.clips_of(skill), library, states, commands)
        }
        if not self.experts:
            raise StageError(
                "no clip says what an expert was commanded; record them again with lacoloco "
                "generate, or train with expert_rounds=0"
            )

    @property
    def steps(self) -> int:
        """Control steps of one collection, one expert after the other."""
        return sum(worlds.steps for worlds in self.experts.values())

    def state_dict(self) -> dict[str, Any]:
        """What the next collection begins with."""
        return {name: worlds.state_dict() for name, worlds in self.experts.items()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore :meth:`state_dict`."""
        for name, worlds in self.experts.items():
            worlds.load_state_dict(state[name])

    def collect(
        self, student: Student, noise: torch.Tensor, action_noise: float, history: int = 1
    ) -> tuple[LabelledStates, float]:
        """Let the policy move by itself and ask every expert at every step; see
        :meth:`~lacoloco.pipelines.low_level.expert_worlds.ExpertWorlds.collect`.

        Returns:
            The states, and falls per 1000 steps.
        """
        collected = [
            worlds.collect(student, noise, action_noise, history)
            for worlds in self.experts.values()
        ]
        states, steps, falls = zip(*collected, strict=True)
        return LabelledStates.joined(list(states)), 1000.0 * sum(falls) / sum(steps)


def _watched_clips(
    spec: RobotSpec,
    name: str,
    skill: str,
    library: MotionLibrary,
    states: ClipStates,
    commands: torch.Tensor,
) -> WatchedClips:
    """What the expert of the task ``name`` watches: its own clips, and if it walks on command the
    others' as well, for which it comes to rest.
    """
    clips = library.clips_of(skill)
    own = torch.isin(_numbers(library, states), clips)
    stops = torch.zeros_like(own)
    if isinstance(load_task(spec, name).command, VelocityCommand):
        stops = ~own
    performed = torch.where(own[:, None], commands, 0.0)
    rest = resting_rows(spec, states)
    starts = torch.cat((rest, states.first))
    return WatchedClips(clips, performed, torch.nonzero(own | stops).flatten(), stops, starts)


def _numbers(library: MotionLibrary, states: ClipStates) -> torch.Tensor:
    """(M,) number of the clip that each row of the clips' states belongs to."""
    count = states.last[states.first] - states.first + 1
    return torch.repeat_interleave(torch.arange(len(library), device=library.device), count)


def _commands(library: MotionLibrary, states: ClipStates) -> torch.Tensor:
    """(M, 3) what the experts were commanded row by row, NaN where nobody knows."""
    number = _numbers(library, states)
    times = CONTROL_DT * (torch.arange(len(number), device=number.device) - states.first[number])
    return library.commands(number, times, CONTROL_DT)


def _known(
    clips: torch.Tensor, library: MotionLibrary, states: ClipStates, commands: torch.Tensor
) -> bool:
    """Whether there are such clips and all say what was commanded."""
    asked = torch.isin(_numbers(library, states), clips)
    return len(clips) > 0 and bool(commands[asked].isfinite().all())
