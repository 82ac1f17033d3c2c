"""All clips of a task as flat tensors: states at any time, and transitions to learn from."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch

from lacoloco.datasets import series
from lacoloco.datasets.clip import Clip, common_joints, flat_clips, table_of
from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.flat_clips import FlatClips
from lacoloco.datasets.great_circles import great_circles

Weighting = Literal["duration", "clip", "skill"]

_ASKED = ("joint_target", "command", "gait_memory")
_LINEAR = ("root_pos", "root_lin_vel_b", "root_ang_vel_b", "joint_pos", "joint_vel")


@dataclass(frozen=True)
class MotionFrames:
    """States of n robots, as tensors (n, width); frames and units as in `Clip`."""

    root_pos: torch.Tensor
    root_quat: torch.Tensor
    root_lin_vel_b: torch.Tensor
    root_ang_vel_b: torch.Tensor
    joint_pos: torch.Tensor
    joint_vel: torch.Tensor


@dataclass(frozen=True)
class Emphasis:
    """How much more often the moments of m parts of clips are drawn.

    Attributes:
        clips: (m,) numbers of the clips.
        begin: (m,) seconds from the start of its clip at which a part begins.
        end: (m,) seconds at which it ends.
        factor: (m,) factor on how often its moments are drawn.
    """

    clips: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    factor: np.ndarray


class MotionLibrary:
    """Clips of one robot, ready to be sampled in batches."""

    def __init__(
        self,
        clips: Sequence[Clip],
        device: str | torch.device = "cpu",
        *,
        weighting: Weighting = "duration",
        skill_shares: Mapping[str, float] | None = None,
    ) -> None:
        """Take the clips' flat arrays, in single precision, and their orientations between frames.

        On the CPU, arrays of clips that were read from one artifact are not copied.

        Args:
            clips: at least one, all with the same joints.
            device: where the tensors live.
            weighting: how often a clip is sampled: "duration", its weight times its seconds, so
                that every moment counts the same; "clip", its weight alone; "skill", the share of
                its skill, divided within the skill as by "duration".
            skill_shares: relative share of each skill for "skill"; equal shares by default.

        Raises:
            DatasetError: no clips, different joints, or weights that leave nothing to sample.
        """
        self.joint_names = common_joints(clips)
        flat = flat_clips(clips, _ASKED)
        table = table_of(clips)
        self.names = tuple(row["name"] for row in table)
        self.device = torch.device(device)
        self.skills = tuple(row["skill"] for row in table)
        """The skill of each clip."""
        self._weights = np.array([row["weight"] for row in table])
        fps = np.array([row["fps"] for row in table])
        self._durations = (np.diff(flat.offsets) - 1) / fps
        self._weighting, self._shares = weighting, _skill_shares(self.skills, skill_shares)
        self._parts = Emphasis(
            np.arange(len(clips)), np.zeros(len(clips)), self._durations, np.ones(len(clips))
        )
        self._cumulative: dict[float, tuple[torch.Tensor, ...]] = {}

        self._first = self._tensor(flat.offsets[:-1], torch.long)
        self._last = self._tensor(np.diff(flat.offsets) - 1, torch.long)
        self._fps = self._tensor(fps)
        self.durations = self._tensor(self._durations)
        """(clips,) seconds of each clip."""
        self._widths = [3, 3, 3, len(self.joint_names), len(self.joint_names)]
        self._states = [self._tensor(flat.series[name]) for name in _LINEAR]
        self._circles = self._tensor(great_circles(flat.series["root_quat"], flat.offsets))
        self._known = {name: self._known_rows(flat, name) for name in _ASKED}
        self._draw(0.0)  # refuse weights that leave nothing to sample now, not in mid-training

    def __len__(self) -> int:
        """Number of clips."""
        return len(self.names)

    def frames(self, clip_ids: torch.Tensor, times: torch.Tensor) -> MotionFrames:
        """States at any time: linear between frames, slerp for the orientation.

        Args:
            clip_ids: (n,) int64 indices of clips.
            times: (n,) seconds from the start of each clip; clamped to the clip.

        Returns:
            n states, float32; fields are views of one tensor.
        """
        position = (times * self._fps[clip_ids]).clamp_(min=0)
        low = torch.minimum(position.long(), self._last[clip_ids])
        share = (position - low).to(torch.float32)[:, None]
        # The last frame leads nowhere, which is also what clamps times beyond the end.
        high = torch.minimum(low + 1, self._last[clip_ids]) + self._first[clip_ids]
        low += self._first[clip_ids]
        quat, axis, angle = self._circles.index_select(0, low).split((4, 4, 1), dim=1)
        angle = share * angle
        quat = (angle.cos() * quat).addcmul_(angle.sin(), axis)
        both = torch.cat([low, high])
        states = torch.cat([rows.index_select(0, both) for rows in self._states], dim=1)
        state, end = states.chunk(2)
        parts = torch.addcmul(state, share, end.sub_(state)).split(self._widths, dim=1)
        return MotionFrames(root_quat=quat, **dict(zip(_LINEAR, parts, strict=True)))

    def joint_targets(self, clip_ids: torch.Tensor, times: torch.Tensor, dt: float) -> torch.Tensor:
        """(n, J) rad, where the motors were asked to go from ``times`` (n,) on, for ``dt`` seconds.

        NaN where that is not known: no robot performed the clip, or it was asked at another rate.
        """
        return self._asked("joint_target", clip_ids, times, dt)

    def commands(self, clip_ids: torch.Tensor, times: torch.Tensor, dt: float) -> torch.Tensor:
        """(n, 3) what an expert was told to do from ``times`` (n,) on, for ``dt`` seconds.

        NaN where that is not known, as for :meth:`joint_targets`.
        """
        return self._asked("command", clip_ids, times, dt)

    def gait_memory(self, clip_ids: torch.Tensor, times: torch.Tensor, dt: float) -> torch.Tensor:
        """(n, 3) where an expert's gait clock stood at ``times`` (n,), read every ``dt`` seconds.

        NaN where that is not known, as for :meth:`joint_targets`.
        """
        return self._asked("gait_memory", clip_ids, times, dt)

    def clips_of(self, skill: str) -> torch.Tensor:
        """(n,) int64 numbers of the clips that show a skill."""
        shown = [index for index, name in enumerate(self.skills) if name == skill]
        return torch.tensor(shown, dtype=torch.long, device=self.device)

    def emphasised(self, parts: Emphasis) -> MotionLibrary:
        """The same clips, some moments of which are drawn more often; others are not drawn."""
        other = copy.copy(self)
        other._parts, other._cumulative = parts, {}
        other._draw(0.0)
        return other

    def shares(self) -> torch.Tensor:
        """(clips,) float64 shares of the clips among the moments that are drawn."""
        edges, clip_ids = self._draw(0.0)[:2]
        drawn = torch.zeros(len(self), dtype=torch.float64, device=self.device)
        return drawn.index_add(0, clip_ids, edges.diff())

    def sample(
        self, n: int, generator: torch.Generator | None = None, margin: float = 0.0
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Draw n moments.

        Args:
            n: how many.
            generator: source of randomness on the library's device.
            margin: seconds that must remain between the moment and the end of its clip; shorter
                clips are left out.

        Returns:
            Indices of clips (n,) int64 and times in s (n,) float32, uniform within each clip.

        Raises:
            DatasetError: no clip is longer than the margin.
        """
        edges, clip_ids, begin, seconds = self._draw(margin)
        # One number gives both: which part it falls into, and how far into it.
        number = torch.rand(n, generator=generator, device=self.device, dtype=torch.float64)
        part = torch.searchsorted(edges[1:-1], number, right=True)
        start = edges[part]
        within = (number - start) / (edges[part + 1] - start)
        return clip_ids[part], (begin[part] + within * seconds[part]).to(torch.float32)

    def sample_transitions(
        self, n: int, dt: float, generator: torch.Generator | None = None
    ) -> tuple[MotionFrames, MotionFrames]:
        """Draw n pairs of states `dt` apart, both within one clip.

        Where `dt` is a whole number of frames, both are recorded frames: blended ones are smoother
        than any that a robot passes through, which is all a discriminator would need to tell them
        apart.

        Args:
            n: how many.
            dt: seconds between the two.
            generator: source of randomness on the library's device.

        Returns:
            The states at t and those at t + dt, in this order: the older first, as an agent's
            transitions are.

        Raises:
            DatasetError: no clip is as long as `dt`.
        """
        clip_ids, times = self.sample(n, generator, margin=dt)
        fps = self._fps[clip_ids]
        whole = (fps * dt - (fps * dt).round()).abs() < 1e-4
        times = torch.where(whole, (times * fps).round() / fps, times)
        both = self.frames(torch.cat([clip_ids, clip_ids]), torch.cat([times, times + dt]))
        halves = [
            MotionFrames(**{name: getattr(both, name)[part] for name in series.SERIES})
            for part in (slice(0, n), slice(n, None))
        ]
        return halves[0], halves[1]

    def _asked(
        self, name: str, clip_ids: torch.Tensor, times: torch.Tensor, dt: float
    ) -> torch.Tensor:
        values, first = self._known[name]
        frame = torch.minimum((times * self._fps[clip_ids]).round().long(), self._last[clip_ids])
        begin = first[clip_ids]
        rows = values[begin.clamp(min=0) + torch.where(begin < 0, 0, frame)]
        other = (self._fps[clip_ids] * dt - 1.0).abs() > 1e-4
        return rows.masked_fill((other | (begin < 0))[:, None], float("nan"))

    def _known_rows(self, flat: FlatClips, name: str) -> tuple[torch.Tensor, torch.Tensor]:
        """What some clips know, and the row at which each clip begins there, -1 for the others."""
        if name in flat.known:
            known = flat.known[name]
            return self._tensor(known.values), self._tensor(known.first, torch.long)
        width = series.width(name, len(self.joint_names))
        nowhere = torch.full((len(flat),), -1, dtype=torch.long, device=self.device)
        return torch.zeros((1, width), device=self.device), nowhere

    def _tensor(self, values: object, dtype: torch.dtype = torch.float32) -> torch.Tensor:
        return torch.as_tensor(np.asarray(values), dtype=dtype, device=self.device)

    def _draw(self, margin: float) -> tuple[torch.Tensor, ...]:
        """Edges (m + 1,) of the parts' shares on [0, 1], the numbers (m,) of their clips, and where
        they begin and how many seconds there are to draw from (m,).
        """
        if margin not in self._cumulative:
            # A clip without room between margin and end can still give its first frame.
            seconds = self._durations - margin
            possible = seconds > -1e-6
            seconds = np.maximum(seconds, 0.0)
            shares = np.where(possible, self._weights, 0.0)
            if self._weighting != "clip":
                shares = shares * np.maximum(seconds, 1e-6)
            if self._weighting == "skill":
                shares = self._balance_skills(shares)
            parts = self._parts
            whole = np.maximum(seconds[parts.clips], 1e-6)
            # The first part of a clip can give its first frame, if nothing else.
            least = np.where(parts.begin == 0.0, 1e-6, 0.0)
            room = np.minimum(parts.end, seconds[parts.clips]) - parts.begin
            shares = shares[parts.clips] * (np.maximum(room, least) / whole) * parts.factor
            room = np.maximum(room, 0.0)
            if not shares.sum() > 0:
                raise DatasetError(
                    f"no clip with a positive weight lasts {margin:g} s; give longer clips"
                )
            edges = np.concatenate([[0.0], np.cumsum(shares)]) / shares.sum()
            self._cumulative[margin] = (
                self._tensor(edges, torch.float64),
                self._tensor(parts.clips, torch.long),
                self._tensor(parts.begin, torch.float64),
                self._tensor(room, torch.float64),
            )
        return self._cumulative[margin]

    def _balance_skills(self, shares: np.ndarray) -> np.ndarray:
        result = np.zeros_like(shares)
        for skill, share in self._shares.items():
            members = np.array([name == skill for name in self.skills])
            total = shares[members].sum()
            if total > 0:
                result[members] = share * shares[members] / total
        return result


def _skill_shares(skills: Sequence[str], wanted: Mapping[str, float] | None) -> dict[str, float]:
    known = sorted(set(skills))
    if wanted is None:
        return dict.fromkeys(known, 1.0)
    for skill, share in wanted.items():
        if skill not in known or not 0 <= share < np.inf:
            raise DatasetError(
                f"skill_shares: '{skill}' = {share}; name these skills with shares >= 0:"
                f" {', '.join(known)}"
            )
    return {skill: float(wanted.get(skill, 0.0)) for skill in known}
