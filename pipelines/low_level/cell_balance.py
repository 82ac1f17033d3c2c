"""Demonstrations, cloned windows and resets drawn more evenly over what the clips show.

Clips show some things often and others seldom: of the windows of a walking expert every fifth turns
clearly. What is seldom shown is seldom learned, and a latent for it is soon lost.

Each skill is drawn as often as before. Nearly all cells are of walking, so that over all cells
alike reaching would fall from three moments in five to one in ten.
"""

from __future__ import annotations

import numpy as np
import torch

from lacoloco.datasets.motion_library import Emphasis, MotionLibrary
from lacoloco.pipelines.evaluation.skill_cells import SkillCells
from lacoloco.pipelines.evaluation.skill_coverage import REACH_SECONDS, standing_height_of
from lacoloco.pipelines.sim.clip_actions import ClipStates, clip_states
from lacoloco.pipelines.sim.kinematics import EndEffectorChain
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.sim.state import RobotState
from lacoloco.robots.spec import RobotSpec

WINDOW_S = 1.5
"""Length of the windows whose cells are told, as of those whose coverage is measured [s]."""


def balanced(spec: RobotSpec, library: MotionLibrary, balance: float) -> MotionLibrary:
    """The library with moments drawn by their cells.

    Args:
        spec: The robot.
        library: The clips.
        balance: 0 draws every cell as often as before, 1 all cells of a skill alike; between, a
            cell that was drawn with a share p is drawn as often as p^(1 - balance) says.
    """
    if balance == 0.0:
        return library
    states = clip_states(library)
    lengths = states.last[states.first] - states.first + 1
    clip = torch.repeat_interleave(torch.arange(len(library), device=lengths.device), lengths)
    kind, skill = _kinds(spec, library, states, clip)
    used = torch.bincount(kind, (library.shares() / lengths)[clip]).clamp_min(1e-12)
    wanted = used.pow(1.0 - balance)
    before, after = (torch.bincount(skill, share)[skill] for share in (used, wanted))
    factor = wanted / after * before / used
    starts = torch.ones_like(kind, dtype=torch.bool)
    starts[1:] = (kind[1:] != kind[:-1]) | (clip[1:] != clip[:-1])
    rows = torch.nonzero(starts).flatten()
    clips = clip[rows].cpu().numpy()
    begin = CONTROL_DT * (rows - states.first[clip[rows]]).double().cpu().numpy()
    last = np.append(clips[1:] != clips[:-1], True)
    end = np.where(last, library.durations.double().cpu().numpy()[clips], np.roll(begin, -1))
    return library.emphasised(Emphasis(clips, begin, end, factor[kind[rows]].cpu().numpy()))


def _kinds(
    spec: RobotSpec, library: MotionLibrary, states: ClipStates, clip: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """(M,) int64 number of the cell and skill of each row of the clips, and (kinds,) that of each
    one's skill; ``clip`` (M,) is the rows'.
    """
    names = sorted(set(library.skills))
    numbers = torch.tensor([names.index(name) for name in library.skills], device=clip.device)
    cells = SkillCells.of(spec).index(window_motion(spec, states))
    both = torch.cat((cells, numbers[clip][:, None]), dim=1)
    kinds, kind = torch.unique(both, dim=0, return_inverse=True)
    return kind, kinds[:, -1]


def window_motion(spec: RobotSpec, states: ClipStates) -> torch.Tensor:
    """(M, 4) mean forward and lateral velocity [m/s], yaw rate [rad/s] over the window that begins
    at each row of the clips, and lift [m] over its last second; shorter where the clip ends.
    """
    state = RobotState.from_generalized(states.qpos, states.qvel)
    height = EndEffectorChain(spec, states.qpos.device)(states.qpos)[:, 2]
    lift = height - standing_height_of(spec, states.qpos.device)
    velocity = torch.cat((state.lin_vel_b[:, :2], state.ang_vel_b[:, 2:]), dim=1)
    rows = torch.arange(len(lift), device=lift.device)
    end = torch.minimum(rows + round(WINDOW_S / CONTROL_DT), states.last + 1)
    late = torch.maximum(rows, end - round(REACH_SECONDS / CONTROL_DT))
    return torch.cat((_means(velocity, rows, end), _means(lift[:, None], late, end)), dim=1)


def _means(values: torch.Tensor, begin: torch.Tensor, end: torch.Tensor) -> torch.Tensor:
    """(M, k) means of the rows of ``values`` (M, k) from ``begin`` (M,) to before ``end`` (M,)."""
    sums = torch.nn.functional.pad(values.double().cumsum(0), (0, 0, 1, 0))
    return ((sums[end] - sums[begin]) / (end - begin)[:, None]).to(values.dtype)
