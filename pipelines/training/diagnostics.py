"""What is wrong with a training, by name, from its metrics alone.

Each check takes the metrics of all iterations so far, oldest first, and returns one line, ``name:
evidence; what to try``, or nothing. Noisy metrics are averaged over the last ``WINDOW`` iterations,
and nothing is said before ``WARM_UP`` of them: every training begins by standing, with latents that
mean nothing yet.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

Metrics = Mapping[str, Any]
History = Sequence[Metrics]

WINDOW, WARM_UP = 20, 40
SATURATED_ACCURACY, SATURATED_REWARD = 0.95, 0.1
"""A blind discriminator is right half of the time and pays ln 2 = 0.69. At 95 to 99 % right the
policy was paid 0.03 and learned nothing (README of learn/); 0.1 is what it gets where it is taken
for a demonstration one time in ten.
"""
IGNORED_COSINE = 0.1
"""The encoder's cosine is 0 for guesses, 0.3 after 0.7 M samples of a training that steers, 0.7 at
its end. The diversity loss tells less: small actions leave it at 0.98 (1: ignored) where latents do
steer.
"""
STANDS, CLIPS_STAND = 0.9, 0.5
"""Share of latents that stand, where at most this share of the clips does."""
COLLAPSED, SKILL_SHARE = 0.95, 0.05
"""Share of latents of one kind, where this share of the clips is of each of two kinds at least."""
LOST, TURNS, TURNS_LEFT = 0.6, 0.02, 0.25
"""The latents reach less than the first share of what as many moments of the clips would. The clips
turn to one side in at least the second share of their moments, the latents in less than the third
share of that.
"""
HACKED_MOVES, HACKED_STARTS = 0.4, 0.2
"""In training at least the first share of the clips' speed, from a standing start at most the
second share of that.
"""
ONE_LATENT = 0.95
"""Mean resultant length of the chosen latents: all within some 18 degrees of one direction."""
STILL_SHARE = 0.2
"""Share of the robot's walking speed below which a high level goes nowhere. Solo12: 0.03 m/s, 30 cm
in an episode whose target is up to 1.5 m away.
"""


def low_level_warnings(history: History) -> list[str]:
    """All that holds of a low level's training now."""
    checks = (
        discriminator_saturated,
        latents_ignored,
        mode_collapse,
        policy_just_stands,
        skills_lost,
        one_way_only,
        reward_hacked_by_resets,
    )
    return _all(checks, history)


def high_level_warnings(history: History, walk_speed: float) -> list[str]:
    """All that holds of a high level's training now.

    Args:
        history: Metrics so far.
        walk_speed: From which the robot counts as walking, m/s; 0 for a task that can be done
            without walking.
    """
    return _all((one_latent_only, partial(goes_nowhere, walk_speed=walk_speed)), history)


def discriminator_saturated(history: History) -> str | None:
    """The discriminator is always right, so that its reward no longer says what would be better."""
    accuracy = 0.5 * (_mean(history, "agent_accuracy") + _mean(history, "demo_accuracy"))
    reward = _mean(history, "imitation_reward")
    if accuracy > SATURATED_ACCURACY or reward < SATURATED_REWARD:
        return (
            f"discriminator saturated: right {accuracy:.0%} of the time, pays {reward:.2f} "
            "(undecided: 0.69); try a lower"
            " max_accuracy (ase.drail, ase.gan) or ase.learning_rate, or less exploration noise "
            "(std)"
        )
    return None


def latents_ignored(history: History) -> str | None:
    """The latent does not steer: nobody can tell from the motion which one was in force."""
    cosine = _mean(history, "encoder_cosine")
    if cosine < IGNORED_COSINE:
        return (
            f"latents ignored: encoder cosine {cosine:.2f} (guessing: 0), diversity loss "
            f"{_mean(history, 'diversity'):.2f}"
            " (ignored: 1); try a larger ase.encoder_weight or ase.diversity"
        )
    return None


def mode_collapse(history: History) -> str | None:
    """Whatever the latent, the robot does one thing, and it is not standing; the clips show
    several.
    """
    latest = _latest(history, "coverage_walk")
    shares = {name: latest.get(f"coverage_{name}", 0.0) for name in ("walk", "reach", "fall")}
    kind = max(shares, key=lambda name: shares[name])
    shown = [
        name
        for name in ("walk", "reach", "stand")
        if latest.get(f"clips_{name}", 0.0) >= SKILL_SHARE
    ]
    if shares[kind] > COLLAPSED and len(shown) > 1:
        return (
            f"mode collapse: {shares[kind]:.0%} of the latents {kind}, the clips "
            f"{' and '.join(shown)}; try a larger"
            " ase.encoder_weight, or skill_shares"
        )
    return None


def policy_just_stands(history: History) -> str | None:
    """From a standing start most latents stay where they are, while the clips move."""
    latest = _latest(history, "coverage_stand")
    stands, clips = latest.get("coverage_stand", 0.0), latest.get("clips_stand", 1.0)
    if stands > STANDS and clips < CLIPS_STAND:
        return (
            f"policy just stands: {stands:.0%} of the latents stand from a standing start, "
            f"{clips:.0%} of the clips; try"
            " more bc_steps, fewer resets into clips (clip_share) or more exploration (std)"
        )
    return None


def skills_lost(history: History) -> str | None:
    """The latents do only a part of what the clips show: some velocities and heights are gone."""
    latest = _latest(history, "coverage_cells")
    reached, clips = latest.get("coverage_cells", 1.0), latest.get("clips_cells", 0.0)
    if reached < LOST * clips:
        return (
            f"skills lost: the latents reach {reached:.0%} of what the clips show, as many moments "
            f"of the clips {clips:.0%}; see which: `lacoloco runs coverage`; try cell_balance"
        )
    return None


def one_way_only(history: History) -> str | None:
    """The clips turn to a side that the latents do not turn to."""
    latest = _latest(history, "coverage_cells")
    for side in ("left", "right"):
        clips = latest.get(f"clips_turn_{side}", 0.0)
        turns = latest.get(f"coverage_turn_{side}", 1.0)
        if clips >= TURNS and turns < TURNS_LEFT * clips:
            return (
                f"hardly turns {side}: {turns:.1%} of the latents do, {clips:.1%} of the clips' "
                "moments; try cell_balance, or experts that turn better"
            )
    return None


def reward_hacked_by_resets(history: History) -> str | None:
    """The policy moves in training, where resets put it into clips and noise carries it, and not
    from a standing start.
    """
    latest = _latest(history, "coverage_speed")
    moves, starts = _mean(history, "speed"), latest.get("coverage_speed", float("nan"))
    clips = latest.get("clips_speed", float("nan"))
    if moves > HACKED_MOVES * clips and starts < HACKED_STARTS * moves:
        return (
            f"reward hacked by resets: {moves:.2f} m/s in training (clips {clips:.2f}), "
            f"{starts:.2f} m/s from a standing"
            " start without noise; try a lower clip_share, longer episode_s or less noise (std)"
        )
    return None


def one_latent_only(history: History) -> str | None:
    """The high level chooses much the same latent whatever it sees."""
    resultant, directions = _mean(history, "latent_resultant"), _mean(history, "latent_directions")
    if resultant > ONE_LATENT:
        return (
            "mode collapse: the high level keeps to one latent (mean resultant length "
            f"{resultant:.2f}, {directions:.1f}"
            " directions in use); try a larger std, or another low level"
        )
    return None


def goes_nowhere(history: History, walk_speed: float) -> str | None:
    """The high level has learned to stand."""
    speed = _mean(history, "speed")
    if speed < STILL_SHARE * walk_speed:
        return (
            f"policy just stands: {speed:.3f} m/s on average; see what the low level can do: "
            "`lacoloco play --latents`"
        )
    return None


def _all(checks: Sequence[Callable[[History], str | None]], history: History) -> list[str]:
    if len(history) < WARM_UP:
        return []
    return [line for line in (check(history) for check in checks) if line is not None]


def _mean(history: History, name: str) -> float:
    """Mean of the last iterations that have the metric; NaN, which no threshold is passed by, where
    none has.
    """
    values = [metrics[name] for metrics in history[-WINDOW:] if name in metrics]
    return sum(values) / len(values) if values else float("nan")


def _latest(history: History, name: str) -> Metrics:
    """The newest iteration that has the metric."""
    return next((metrics for metrics in reversed(history) if name in metrics), {})
