"""Worlds in which a policy moves by itself and an expert is asked at every step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Any

import torch

from lacoloco.pipelines.evaluation.hardware_shift import IN_TRAINING
from lacoloco.pipelines.generation.expert_trainer import without_noise
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.sim.clip_actions import ClipStates, infer_actions, with_memory
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.hierarchical_env import HOLD_STEPS
from lacoloco.pipelines.sim.readings import Record
from lacoloco.pipelines.sim.state import RobotState, style_frame
from lacoloco.pipelines.sim.step import Step
from lacoloco.pipelines.sim.tasks import Task, load_task
from lacoloco.robots.spec import RobotSpec

Student = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]
"""(N, history (F + A)) readings, newest first, and (N,) rows of the clips -> (N, A) mean actions
under the latents of those rows.
"""
LOST_STEPS = 20
"""Control steps before a fall in which nothing could be saved any more."""


_COLUMNS = ("frames", "previous", "actions", "rows")


@dataclass(frozen=True)
class LabelledStates:
    """States that a policy reached by itself, and what an expert would do there.

    Attributes:
        frames: (n, F) style frames, as sensors without noise give them.
        previous: (n, A) actions before, in units of the imitation task, and its memory.
        actions: (n, A) the expert's actions, likewise.
        rows: (n,) rows of the clips that the policy was performing.
        before: (n,) which of these states was one control step earlier; a state itself where the
            one before it does not count.
    """

    frames: torch.Tensor
    previous: torch.Tensor
    actions: torch.Tensor
    rows: torch.Tensor
    before: torch.Tensor

    def __len__(self) -> int:
        """Number of states n."""
        return len(self.rows)

    def sampled(self, count: int, history: int, generator: torch.Generator) -> LabelledStates:
        """About ``count`` of them or all, with the ``history`` - 1 states before each."""
        if count >= len(self):
            return self
        order = torch.randperm(len(self), generator=generator, device=generator.device)
        chosen = readings = order[: max(1, count // history)]
        for _ in range(1, history):
            readings = self.before[readings]
            chosen = torch.cat((chosen, readings))
        chosen = chosen.unique()
        before = torch.searchsorted(chosen, self.before[chosen]).clamp(max=len(chosen) - 1)
        own = torch.arange(len(chosen), device=chosen.device)
        kept = {name: getattr(self, name)[chosen] for name in _COLUMNS}
        follows = chosen[before] == self.before[chosen]
        return LabelledStates(**kept, before=torch.where(follows, before, own))

    @classmethod
    def joined(cls, parts: list[LabelledStates]) -> LabelledStates:
        """All of them."""
        joined = {name: torch.cat([getattr(part, name) for part in parts]) for name in _COLUMNS}
        firsts = accumulate((len(part) for part in parts), initial=0)
        before = [first + part.before for first, part in zip(firsts, parts, strict=False)]
        return cls(**joined, before=torch.cat(before))


@dataclass(frozen=True)
class WatchedClips:
    """What a policy is asked to perform while one expert watches.

    Attributes:
        clips: (K,) numbers of the clips that the expert performed.
        commands: (M, 3) what the expert is asked at every row of the clips.
        rows: (R,) rows that may be performed.
        stops: (M,) bool: at these rows the expert only knows how to come to rest, which others
            begin with. What it says once the robot rests does not count.
        starts: (S,) rows at which a robot rests: where a world may begin, as well as where the
            imitation task begins.
    """

    clips: torch.Tensor
    commands: torch.Tensor
    rows: torch.Tensor
    stops: torch.Tensor
    starts: torch.Tensor


class ExpertWorlds:
    """The worlds of one expert.

    In half of them the policy performs one clip from its start; in the others it takes up one
    moment of some clip after the other, as under a high level. What the expert says has to be a
    function of what the policy sees: so an expert with a gait's clock reads it from the policy's
    memory, and leads the arm on from where the policy's last action led it.
    """

    def __init__(
        self,
        spec: RobotSpec,
        name: str,
        expert: Policy,
        states: ClipStates,
        watched: WatchedClips,
        *,
        worlds: int,
        hold_steps: int,
        seed: int,
        shifted: bool = False,
    ) -> None:
        """Build ``worlds`` worlds of the expert's task ``name``; the latent of one moment is held
        for at most ``hold_steps`` control steps, in some worlds no longer than a high level does.
        ``shifted`` worlds differ by the hardware shift.
        """
        device = states.qpos.device
        self._expert, self._states, self._watched = expert, states, watched
        imitate = load_task(spec, "imitate")
        self._scale, self._joints = imitate.action_scale, spec.num_joints
        actions = infer_actions(spec, states, self._scale)
        self._previous = with_memory(states, actions, imitate.memory)[1]
        self._rests = spec.skills.walk_speed
        task = _performed(load_task(spec, name), imitate)
        if shifted:
            task = IN_TRAINING.apply(task)
        self.env = LeggedEnv(spec, task, worlds, seed=seed, device=str(device))
        self._generator = torch.Generator(device).manual_seed(seed)
        place = torch.arange(worlds, device=device) / worlds
        self._performs = place < 0.5
        shortest = min(HOLD_STEPS, hold_steps)
        self._hold_steps = shortest * (hold_steps / shortest) ** (2.0 * place - 1.0)
        self._row = torch.zeros(worlds, dtype=torch.long, device=device)
        self._left = torch.zeros_like(self._row)
        self._last_action = torch.zeros_like(self._previous[self._row])

    @property
    def steps(self) -> int:
        """Control steps of one collection."""
        states, clips = self._states, self._watched.clips
        return int((states.last[states.first[clips]] - states.first[clips]).min())

    def state_dict(self) -> dict[str, Any]:
        """What the next collection begins with."""
        return {"env": self.env.state_dict(), "generator": self._generator.get_state()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore :meth:`state_dict`."""
        self.env.load_state_dict(state["env"])
        self._generator.set_state(state["generator"])

    def collect(
        self, student: Student, noise: torch.Tensor, action_noise: float, history: int = 1
    ) -> tuple[LabelledStates, int, int]:
        """Let the policy move for as long as the shortest clip, and ask the expert.

        Half of the worlds begin as the expert and are handed over at a time of their own, so that
        the policy is also seen in the middle of what the expert began. Where the robot falls, the
        world begins anew.

        Args:
            student: The policy.
            noise: (F + A,) half-ranges of the uniform noise on what it sees, in every other world.
                With noise nothing ever rests; an arm that rests far from where it should be would
                not be seen.
            action_noise: Standard deviation of the noise on its actions, in the same worlds.
            history: How many readings it sees, that of now included.

        Returns:
            The states; how many steps there were; how many robots fell.
        """
        env, steps = self.env, self.steps
        handover = steps * self._uniform() * (self._uniform() < 0.5)
        self._begin(torch.ones_like(self._performs))
        kept, counted, falls = [], [], torch.zeros((), dtype=torch.long, device=env.device)
        noisy = (torch.arange(env.num_worlds, device=env.device) % 2)[:, None]
        record: Record | None = None
        began = [torch.ones_like(self._performs)]
        for step in range(steps):
            frame, last, row = style_frame(env.seen()), self._last_action, self._row
            speed = torch.linalg.vector_norm(env.state.lin_vel_b[:, :2], dim=1)
            counted.append(~self._watched.stops[row] | (speed > self._rests))
            observation = torch.cat((frame, last), dim=-1)
            observation = observation + noisy * noise * (2.0 * self._like(observation) - 1.0)
            record = record or Record(observation, history)
            record.push(observation)
            record.restart(began[-1], observation)
            own = student(record.latest(history), row)
            own = own + noisy * action_noise * self._like(own, torch.randn)
            own = own.masked_fill((step < handover)[:, None], torch.nan)
            outcome, asked, self._last_action = self._step(own)
            kept.append((frame, last, asked, row))
            falls += outcome.fell.sum()
            began.append(outcome.fell)
            for lost in counted[-LOST_STEPS:]:
                lost &= ~outcome.fell
            self._go_on(outcome.fell)
        known = torch.cat(counted)
        columns = [torch.cat(column)[known] for column in zip(*kept, strict=True)]
        columns.append(_states_before(known, torch.stack(began[:-1])))
        joined = LabelledStates(*columns)
        return joined, steps * env.num_worlds, int(falls)

    def _step(self, own: torch.Tensor) -> tuple[Step, torch.Tensor, torch.Tensor]:
        """One control step with the actions ``own`` (N, A), the expert's where they are NaN.

        Returns:
            What happened; the expert's actions and those that were taken, (N, A) each, in units of
            the imitation task.
        """
        env, joints = self.env, self._joints
        if env.guide is not None:
            everywhere = torch.ones_like(self._performs)
            env.guide.clock.recall(self._last_action[:, joints:], everywhere)
            led = env.default_joint_pos + self._scale * self._last_action[:, :joints]
            env.guide.lead_from(led - env.task.action_scale * env.action)
        targets = env.default_joint_pos + self._scale * own[:, :joints]
        outcome = env.step(self._expert(env.observe()), instead=targets)
        asked = (env.joint_target - env.default_joint_pos) / self._scale
        if env.guide is not None:
            asked = torch.cat((asked, env.guide.clock.memory()), dim=1)
        return outcome, asked, torch.where(own.isnan(), asked, own)

    def _begin(self, mask: torch.Tensor) -> None:
        """Begin anew in the worlds of ``mask`` (N,) bool: with a clip, at rest, or as an episode of
        the imitation task does.
        """
        worlds = torch.nonzero(mask).flatten()
        if not len(worlds):
            return
        env, states, watched = self.env, self._states, self._watched
        env.redraw(mask)
        env.reset(mask)
        first = states.first[self._drawn(watched.clips, len(worlds))]
        rest = self._drawn(watched.starts, len(worlds))
        performs = self._performs[worlds]
        begin = torch.where(performs, first, rest)
        placed = performs | (self._uniform()[worlds] < 0.5)
        chosen, there = worlds[placed], begin[placed]
        nothing = torch.zeros_like(env.action[chosen])
        env.start_from(chosen, states.qpos[there], states.qvel[there], nothing)
        self._last_action[worlds] = 0.0
        self._last_action[chosen] = self._previous[there]
        self._row[worlds], self._left[worlds] = begin, states.remaining[begin]
        env.command[worlds] = watched.commands[begin]
        self._take_up(mask & ~self._performs)

    def _take_up(self, mask: torch.Tensor) -> None:
        """Turn to another moment of some clip in the worlds of ``mask`` (N,) bool."""
        worlds = torch.nonzero(mask).flatten()
        row = self._drawn(self._watched.rows, len(worlds))
        self._row[worlds] = row
        self._left[worlds] = (self._hold_steps * self._uniform())[worlds].long()
        command, kind = self._watched.commands[row], self.env.task.command
        assert kind is not None
        pose, recorded = self.env.physics.qpos[worlds, :7], self._states.qpos[row, :7]
        self.env.command[worlds] = kind.carried(command, recorded, pose)

    def _go_on(self, fell: torch.Tensor) -> None:
        follows = self._performs & (self._left > 0)
        self._row = self._row + follows
        self._left = self._left - 1
        # A clip's targets are where it was recorded, and who performs it set out from there.
        asked = self._watched.commands[self._row]
        self.env.command = torch.where(follows[:, None], asked, self.env.command)
        self._take_up(~fell & ~self._performs & (self._left < 0))
        self._begin(fell)

    def _drawn(self, choices: torch.Tensor, count: int) -> torch.Tensor:
        chosen = torch.randint(
            len(choices), (count,), generator=self._generator, device=choices.device
        )
        return choices[chosen]

    def _uniform(self) -> torch.Tensor:
        return self._like(self.env.physics.qpos[:, 0])

    def _like(
        self, values: torch.Tensor, draw: Callable[..., torch.Tensor] = torch.rand
    ) -> torch.Tensor:
        return draw(values.shape, generator=self._generator, device=values.device)


def _states_before(known: torch.Tensor, began: torch.Tensor) -> torch.Tensor:
    """(n,) for each of the n ``known`` (T N,) states of N worlds over T steps the number of the one
    a step earlier; its own where its world ``began`` (T, N) there, or that one is not known.
    """
    number = known.cumsum(dim=0) - 1
    rows = torch.nonzero(known).flatten()
    earlier = (rows - began.shape[1]).clamp(min=0)
    follows = ~began.flatten()[rows] & known[earlier]
    return torch.where(follows, number[earlier], number[rows])


def _performed(task: Task, imitate: Task) -> Task:
    """The expert's task, pushes included, from where the imitation task starts and under the clips'
    commands.
    """
    reset = replace(imitate.reset, clip_share=0.0)
    return replace(without_noise(task), resample_s=None, episode_s=3600.0, reset=reset)


def resting_rows(spec: RobotSpec, states: ClipStates) -> torch.Tensor:
    """(S,) rows of the clips' states in which neither the base nor a joint moves much."""
    state = RobotState.from_generalized(states.qpos, states.qvel)
    numbers = spec.tracking
    speed = torch.linalg.vector_norm(state.lin_vel_b[:, :2], dim=1)
    joints = state.joint_vel.abs().mean(dim=1)
    still = (speed < numbers.resting_speed) & (joints < numbers.resting_joint_speed)
    return torch.nonzero(still).flatten()
