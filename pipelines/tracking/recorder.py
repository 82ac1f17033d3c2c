"""A tracker's performances: which clips it is to follow from where, and what of that is worth
keeping.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from lacoloco.datasets.clip import Clip
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.policies import Policy
from lacoloco.pipelines.sim.clip_actions import ClipStates
from lacoloco.pipelines.sim.physics import CONTROL_DT
from lacoloco.pipelines.tracking.trainer import NEVER, Shadow
from lacoloco.robots.numbers import TrackingTolerances


@dataclass(frozen=True)
class RecordingConfig:
    """What is recorded of a tracker.

    Attributes:
        copies: how often every clip is followed from its beginning, each time by another robot: own
            friction and masses.
        starts: further pieces that begin with a robot that stands in the default pose while its
            clip moves: clips rarely show how one begins, and a policy that has never seen it does
            not.
        start_s: length of those [s].
        stops: further pieces in which a moving robot stops, at any moment of its clip.
        stop_after_s: between how many seconds of its clip come before it stops.
        stand_s: seconds from then on.
        settle_s: seconds after being put into a clip's state that are not recorded: its feet are
            not in the floor yet.
        before_loss_s: seconds before the robot lost its clip that are not recorded either.
        shortest_s: pieces shorter than this are left out.
        rest_s: of every stillness so much is kept at its beginning and at its end; animals rest
            most of the time, and a policy that has seen little else stands [s].
    """

    copies: int = 3
    starts: int = 200
    start_s: float = 5.0
    stops: int = 200
    stop_after_s: tuple[float, float] = (0.5, 2.5)
    stand_s: float = 2.0
    settle_s: float = 0.2
    before_loss_s: float = 0.4
    shortest_s: float = 1.0
    rest_s: float = 1.0


@dataclass(frozen=True)
class Journey:
    """Who follows what: one world each, W in all.

    Attributes:
        rows: (W,) where it begins, as a row of the clips' states.
        steps: (W,) control steps that it takes.
        standing: (W,) bool, whether it begins in the default pose instead of the clip's state.
        stop_at: (W,) the step from which on it is to stand still, ``tracker.NEVER`` for most.
    """

    rows: torch.Tensor
    steps: torch.Tensor
    standing: torch.Tensor
    stop_at: torch.Tensor


def plan(shadow: Shadow, config: RecordingConfig, *, seed: int) -> Journey:
    """Every clip but the last from beginning to end, ``copies`` times, ``starts`` that begin
    standing where a clip moves, ``stops``.

    ``seed`` decides which of the possible starts and stops are taken.
    """
    states, speed = shadow.states, shadow.references.speed
    through = states.first[:-1].repeat(config.copies)
    shortest, longest = (
        round(seconds / CONTROL_DT) for seconds in (2.0 * config.shortest_s, config.start_s)
    )
    ahead = states.last - torch.arange(len(states.last), device=states.last.device)
    limits = shadow.env.spec.tracking
    moving = (speed > limits.moving_speed) & (speed < limits.slow_speed) & (ahead >= shortest)
    begun = _beginnings(
        states, torch.nonzero(moving).flatten(), shadow.env.default_joint_pos, config.starts, seed
    )
    going = torch.nonzero((speed > limits.moving_speed) & (ahead > shortest)).flatten()
    ended, after = _ends(going, ahead, config, seed + 1)
    rows = torch.cat((through, begun, ended))
    standing, stop_at = torch.zeros_like(rows, dtype=torch.bool), torch.full_like(rows, NEVER)
    standing[len(through) : len(through) + len(begun)] = True
    stop_at[len(rows) - len(ended) :] = after
    steps = torch.cat(
        (
            ahead[through],
            ahead[begun].clamp_max(longest),
            after + round(config.stand_s / CONTROL_DT),
        )
    )
    return Journey(rows, steps, standing, stop_at)


def _ends(
    moving: torch.Tensor, ahead: torch.Tensor, config: RecordingConfig, seed: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """(K,) of the rows ``moving``, none where there are none, and (K,) the steps after which to
    stop: before the clip ends.
    """
    draw = torch.Generator().manual_seed(seed)
    count = config.stops if len(moving) else 0
    rows = moving[torch.randint(max(1, len(moving)), (count,), generator=draw).to(moving.device)]
    earliest, latest = (seconds / CONTROL_DT for seconds in config.stop_after_s)
    after = (
        earliest + torch.rand(count, generator=draw).to(moving.device) * (latest - earliest)
    ).long()
    return rows, torch.minimum(after, ahead[rows] - 1)


def _beginnings(
    states: ClipStates, moving: torch.Tensor, default: torch.Tensor, count: int, seed: int
) -> torch.Tensor:
    """(count,) of the rows ``moving``, or none where there are too few: alike in pose, and in which
    legs swing.

    From a standstill a gait can begin in any phase; who has seen all of them begins in their mean,
    which is to stand. So those are taken that swing in one sense of the main component of the joint
    velocities, and of these the quarter that is nearest to the default pose.
    """
    if len(moving) < 8:
        return moving[:0]
    velocity = states.qvel[moving, 6:]
    main = torch.linalg.eigh(velocity.T @ velocity).eigenvectors[:, -1]
    main = main * main[main.abs().argmax()].sign()
    swing = velocity @ main
    one_sense = moving[swing > swing.quantile(0.75)]
    far = (states.qpos[one_sense, 7:] - default).norm(dim=1)
    near = one_sense[far.argsort()[: max(1, len(far) // 4)]]
    draw = torch.Generator().manual_seed(seed)
    return near[torch.randint(len(near), (count,), generator=draw).to(near.device)]


def worlds(clips: Sequence[Clip], config: RecordingConfig) -> int:
    """How many worlds a recording of ``clips``, the last of which is nothing but standing,
    takes.
    """
    return (len(clips) - 1) * config.copies + config.starts + config.stops


def record(
    shadow: Shadow, clips: Sequence[Clip], policy: Policy, config: RecordingConfig, *, seed: int
) -> tuple[list[Clip], dict[str, float]]:
    """Follow the clips as planned, deterministically; what is worth keeping becomes clips.

    Args:
        shadow: :func:`worlds` worlds over the very clips.
        clips: what is followed.
        policy: the tracker.
        config: what to record.
        seed: which beginnings are taken.

    Returns:
        The pieces, and the share of the time that they hold, how often a clip was lost, the mean
        reward, and the clips' and the pieces' mean planar speed [m/s].

    Raises:
        StageError: no piece is long enough.
    """
    journey = plan(shadow, config, seed=seed)
    frames, lost, rewards = _follow(shadow, journey, policy)
    source = torch.searchsorted(shadow.states.first, journey.rows, right=True) - 1
    pieces, limits = [], shadow.env.spec.tracking
    for world, steps in enumerate(journey.steps.tolist()):
        clip, resting = clips[int(source[world])], _resting(frames, world, limits)
        for whole in pieces_of(lost[world, :steps], bool(journey.standing[world]), config):
            for start, stop in without_rest(resting, whole, config):
                series = {name: values[world, start:stop] for name, values in frames.items()}
                pieces.append(_clip(clip, f"{clip.name}_{world:03d}_{start:04d}", series))
    if not pieces:
        raise StageError("the tracker lost every clip too soon; train it longer")
    active = torch.arange(lost.shape[1]) < journey.steps.cpu()[:, None]
    return pieces, {
        "pieces": len(pieces),
        "kept": sum(piece.duration for piece in pieces) / (CONTROL_DT * float(journey.steps.sum())),
        "lost": float((lost & active).sum()),
        "reward_recorded": float(rewards[active].mean()),
        "clip_speed": float(shadow.references.speed.mean()),
        "speed": _mean_speed(pieces),
    }


def _follow(
    shadow: Shadow, journey: Journey, policy: Policy
) -> tuple[dict[str, np.ndarray], torch.Tensor, torch.Tensor]:
    """Series (W, T + 1, ...) of the robots' states; (W, T) bool where they lost their clip, and
    rewards.

    Where a robot lost it is where it goes on, in the clip's own state. Worlds that the plan has no
    use for idle in the first one.
    """
    idle = shadow.env.num_worlds - len(journey.rows)
    rows = torch.cat((journey.rows, journey.rows[:1].expand(idle)))
    standing = torch.cat((journey.standing, journey.standing.new_zeros(idle)))
    shadow.env.episode_steps.fill_(int(shadow.states.last.max()) + 2)
    shadow.put(torch.ones_like(standing), rows, standing)
    shadow.stop_at[: len(journey.rows)] = journey.stop_at
    states, targets, losses, rewards = [_snapshot(shadow)], [], [], []
    for _ in range(int(journey.steps.max())):
        _, reward, lost, _ = shadow.step(policy(*shadow.observe().values()))
        targets.append(
            shadow.env.default_joint_pos + shadow.env.task.action_scale * shadow.env.action
        )
        shadow.put(lost, shadow.rows, torch.zeros_like(lost))
        states.append(_snapshot(shadow))
        losses.append(lost.cpu())
        rewards.append(reward.cpu())
    count, columns = (
        len(journey.rows),
        {name: [state[name] for state in states] for name in states[0]},
    )
    columns["joint_target"] = [*targets, targets[-1]]
    series = {
        name: torch.stack(column, dim=1)[:count].cpu().numpy() for name, column in columns.items()
    }
    return series, torch.stack(losses, dim=1)[:count], torch.stack(rewards, dim=1)[:count]


def pieces_of(
    lost: torch.Tensor, standing: bool, config: RecordingConfig
) -> Iterator[tuple[int, int]]:
    """[start, stop) of the frames of one world that are worth keeping, from where it ``lost`` (T,)
    its clip.
    """
    settle, before, shortest = (
        round(seconds / CONTROL_DT)
        for seconds in (config.settle_s, config.before_loss_s, config.shortest_s)
    )
    start = 0 if standing else settle
    losses = (torch.nonzero(lost).flatten() + 1).tolist()
    for end in [*losses, len(lost) + 1 + before]:
        if end - before - start > shortest:
            yield start, end - before
        start = end + settle


def without_rest(
    resting: np.ndarray, span: tuple[int, int], config: RecordingConfig
) -> Iterator[tuple[int, int]]:
    """What is left of frames [start, stop) when the middle of every stillness, ``resting`` (T,)
    bool, is cut out.
    """
    start, stop = span
    keep, shortest = round(config.rest_s / CONTROL_DT), round(config.shortest_s / CONTROL_DT)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], resting[start:stop].astype(int), [0]))))
    for begin, end in start + edges.reshape(-1, 2):
        if end - begin > 2 * keep:
            if begin + keep - start > shortest:
                yield start, int(begin + keep)
            start = int(end - keep)
    if stop - start > shortest:
        yield start, stop


def _resting(frames: dict[str, np.ndarray], world: int, limits: TrackingTolerances) -> np.ndarray:
    """(T,) bool, where a recorded robot hardly moves."""
    planar = np.linalg.norm(frames["root_lin_vel_b"][world, :, :2], axis=1)
    joints = np.abs(frames["joint_vel"][world]).mean(axis=1)
    return (planar < limits.resting_speed) & (joints < limits.resting_joint_speed)


def _snapshot(shadow: Shadow) -> dict[str, torch.Tensor]:
    state = shadow.env.state
    names = ("root_pos", "root_quat", "joint_pos", "joint_vel")
    named = {name: getattr(state, name).clone() for name in names}
    return named | {
        "root_lin_vel_b": state.lin_vel_b.clone(),
        "root_ang_vel_b": state.ang_vel_b.clone(),
    }


def _clip(source: Clip, name: str, series: dict[str, np.ndarray]) -> Clip:
    about = f"lacoloco track: {source.name}" + (f" ({source.source})" if source.source else "")
    return Clip(
        name=name,
        fps=1.0 / CONTROL_DT,
        joint_names=source.joint_names,
        skill=source.skill,
        weight=source.weight,
        source=about,
        licence=source.licence,
        **series,
    )


def _mean_speed(pieces: Sequence[Clip]) -> float:
    """Mean planar speed of the base over all frames [m/s]."""
    planar = torch.cat([torch.as_tensor(piece.root_lin_vel_b[:, :2]) for piece in pieces])
    return float(planar.norm(dim=-1).mean())
