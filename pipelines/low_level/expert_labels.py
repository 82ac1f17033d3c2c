"""What the experts would do where the cloned policy goes by itself (DAgger; Ross, Gordon and
Bagnell, "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online Learning",
2011).

A policy cloned from clips has only seen the states of the clips. A small error takes it to others,
where nothing pulls it back: a walker on two legs falls. The experts performed the clips on command,
so they can be asked again, wherever the policy is by now.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import torch

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.generation.expert_trainer import without_noise
from lacoloco.pipelines.generation.recorder import SKILLS
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.sim.clip_actions import ClipStates
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.state import style_frame
from lacoloco.pipelines.sim.tasks import Task, load_task
from lacoloco.robots.spec import RobotSpec

Student = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]
"""(N, F + A) observations and (N,) rows of the clips -> (N, A) mean actions under the latents of
those rows.
"""


@dataclass(frozen=True)
class LabelledStates:
    """States that a policy reached by itself, and what an expert would do there.

    Attributes:
        frames: (n, F) clean style frames.
        previous: (n, A) actions before, in units of the imitation task.
        actions: (n, A) the expert's actions, likewise.
        rows: (n,) rows of the clips that the policy was performing.
    """

    frames: torch.Tensor
    previous: torch.Tensor
    actions: torch.Tensor
    rows: torch.Tensor

    def __len__(self) -> int:
        """Number of states n."""
        return len(self.rows)

    @classmethod
    def joined(cls, parts: list[LabelledStates]) -> LabelledStates:
        """All of them."""
        names = ("frames", "previous", "actions", "rows")
        return cls(**{name: torch.cat([getattr(part, name) for part in parts]) for name in names})


class ExpertLabels:
    """Worlds in which a policy performs the clips of every expert, under the commands that the
    expert had.
    """

    def __init__(
        self,
        spec: RobotSpec,
        library: MotionLibrary,
        states: ClipStates,
        experts: Mapping[str, Policy],
        *,
        worlds: int,
        seed: int,
    ) -> None:
        """Build ``worlds`` worlds for every expert whose clips are in the library.

        Raises:
            StageError: No clip says what an expert was commanded.
        """
        self._states, self._generator = states, torch.Generator(library.device).manual_seed(seed)
        self._action_scale = load_task(spec, "imitate").action_scale
        self._stages = []
        for name, skill in SKILLS.items():
            clips = library.clips_of(skill)
            commands = _commands(library, states, clips)
            if name in experts and len(clips) and commands is not None:
                env = LeggedEnv(
                    spec,
                    _performed(load_task(spec, name)),
                    worlds,
                    seed=seed,
                    device=str(library.device),
                )
                self._stages.append((env, experts[name], clips, commands))
        if not self._stages:
            raise StageError(
                "no clip says what an expert was commanded; record them again with lacoloco "
                "generate, or train with expert_rounds=0"
            )

    def collect(self, student: Student) -> tuple[LabelledStates, int]:
        """Let the policy perform clips and ask the experts at every step.

        Half of the worlds begin as the expert and are handed over at a time of their own, so that
        the middle of a clip is met as well as its start. A world in which the robot falls counts
        until then.

        Returns:
            The states, and how many there would be had no robot fallen.
        """
        performed = [self._perform(*stage, student) for stage in self._stages]
        return LabelledStates.joined([states for states, _ in performed]), sum(
            possible for _, possible in performed
        )

    def _perform(
        self,
        env: LeggedEnv,
        expert: Policy,
        clips: torch.Tensor,
        commands: torch.Tensor,
        student: Student,
    ) -> tuple[LabelledStates, int]:
        number = torch.randint(
            len(clips), (env.num_worlds,), generator=self._generator, device=env.device
        )
        first = self._states.first[clips[number]]
        steps = int((self._states.last[first] - first).min())
        handover = self._uniform(env) * (steps * (self._uniform(env) < 0.5))
        self._begin(env, first)
        last_action = torch.zeros_like(env.action)
        alive = torch.ones(env.num_worlds, dtype=torch.bool, device=env.device)
        kept = []
        for step in range(steps):
            env.command = commands[first + step]
            frame = style_frame(env.state)
            action = student(torch.cat((frame, last_action), dim=-1), first + step)
            own = env.default_joint_pos + self._action_scale * action
            own[step < handover] = float("nan")
            outcome = env.step(expert(env.observe()), instead=own)
            asked = (env.joint_target - env.default_joint_pos) / self._action_scale
            kept.append((frame[alive], last_action[alive], asked[alive], (first + step)[alive]))
            last_action = torch.where(own.isnan(), asked, action)
            alive = alive & ~outcome.fell
        states = LabelledStates(*(torch.cat(column) for column in zip(*kept, strict=True)))
        return states, steps * env.num_worlds

    def _begin(self, env: LeggedEnv, rows: torch.Tensor) -> None:
        every = torch.ones(env.num_worlds, dtype=torch.bool, device=env.device)
        env.redraw(every)
        env.reset(every)
        worlds = torch.arange(env.num_worlds, device=env.device)
        env.start_from(
            worlds, self._states.qpos[rows], self._states.qvel[rows], torch.zeros_like(env.action)
        )

    def _uniform(self, env: LeggedEnv) -> torch.Tensor:
        return torch.rand(env.num_worlds, generator=self._generator, device=env.device)


def _performed(task: Task) -> Task:
    """The expert's task, pushes included, from where clips start and under their commands."""
    reset = replace(task.reset, gait_share=0.0)
    return replace(without_noise(task), resample_s=None, episode_s=3600.0, reset=reset)


def _commands(
    library: MotionLibrary, states: ClipStates, clips: torch.Tensor
) -> torch.Tensor | None:
    """(M, 3) commands row by row of the clips' states; None where one of ``clips`` has none."""
    count = states.last[states.first] - states.first + 1
    number = torch.repeat_interleave(torch.arange(len(library), device=library.device), count)
    times = CONTROL_DT * (torch.arange(len(number), device=number.device) - states.first[number])
    commands = library.commands(number, times, CONTROL_DT)
    asked = torch.isin(number, clips)
    return commands if commands[asked].isfinite().all() else None
