"""What there is to run: the paper's methods, and its experiments as chains of stages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from lacoloco.pipelines.errors import StageError

METHODS = {
    "gan": ("gan", False),
    "drail": ("drail", False),
    "gan-cat": ("gan", True),
    "drail-cat": ("drail", True),
}
"""The paper's four methods: discriminator, and whether the foot forces are constrained."""
STAGES = {
    "generate": "generate",
    "retarget": "retarget",
    "track": "track",
    "train-low": "train_low",
    "train-high": "train_high",
    "eval": "evaluate",
    "export": "export",
    "play": "play",
}
"""Verb -> module of ``lacoloco.pipelines``, in the order of the chain."""
INPUT_OF = {"track": "retarget"}
"""Stage that makes motions -> the stage whose motions it takes."""


@dataclass(frozen=True)
class Experiment:
    """One chain.

    Attributes:
        robot: name of the robot.
        motion_stages: those of ``generate``, ``retarget`` and ``track`` that make its motions, in
            their order.
        learn_from: those of them whose motions the low level imitates.
        about: one line for a person.
        episodes: at most so many are evaluated; a quickstart does not need the paper's 4096.
        decisions: at most so many train the high level; a quickstart shows that it works, not how
            well in the end.
        settings: verb -> fields of its config that are not the preset's.
        recipe: the same with dotted names, for all presets but ``smoke``, which stays as small as
            it is, and in trainings ``paper-method``, which is another recipe.
        start_from: names of published policies; the chain begins with the low level of the first
            that there is.
    """

    robot: str
    motion_stages: tuple[str, ...]
    learn_from: tuple[str, ...]
    about: str
    episodes: int = 4096
    decisions: int | None = None
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    recipe: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    start_from: tuple[str, ...] = ()


BALANCE = {
    "networks.actor": (512, 256, 128),
    "networks.critic": (512, 256, 128),
    "ppo.gamma": 0.99,
    "episode_s": 4.0,
    "restart_probability": 0.3,
    "long_horizon_from": 0.05,
}
"""Of ``train-low``, for robots that fall where others stand. A low level that was cloned walks from
the first sample on. What it has to learn is not to fall in ten seconds, so it sees them early, and
values what comes later.
"""
ANSWERED = {
    "samples": 1_600_000,
    "critic_warmup": 0.1,
    "ase.label_weight": 0.02,
}
"""Of ``train-low``, for robots that lose standing under adversarial training: PPO is held to what
the experts answered. Few samples, as it drifts from reaching.
"""
WALKS_MORE: Mapping[str, Mapping[str, Any]] = {
    "train-low": {"cell_balance": 1.0, "skill_shares": (("walk", 0.7), ("reach", 0.3))},
    "train-high": {"decisions": 2_500_000, "std": (0.2, 0.05), "stood_s": (0.0, 1.0)},
}
"""For robots that go in all directions. Their clips' own shares leave four moments in ten to some
thirty ways to walk and turn, and the latents lose the rarer ones.
"""
EXPERIMENTS = {
    "quickstart": Experiment(
        "solo12",
        ("retarget", "generate"),
        ("generate",),
        "the whole chain on Solo12 in minutes",
        episodes=1024,
        decisions=600_000,
        start_from=("solo12-synthetic-low", "solo12-synthetic"),
    ),
    "solo12-synthetic": Experiment(
        "solo12",
        ("generate",),
        ("generate",),
        "walking and reaching experts",
        recipe=WALKS_MORE,
    ),
    "solo12-dog": Experiment(
        "solo12",
        ("retarget", "track"),
        ("track",),
        "a dog's motions, as the robot performs them",
        settings={"retarget": {"augment": True}},
    ),
    "solo12-dog-reach": Experiment(
        "solo12",
        ("retarget", "track", "generate"),
        ("track", "generate"),
        "a dog's motions, and how to reach from an expert: few recordings of dogs show a raised "
        "foot",
        settings={
            "retarget": {"augment": True},
            "generate": {"walk_clips": 0},
            "train-low": {"skill_shares": (("dog", 0.6), ("reach", 0.4))},
        },
    ),
    "go2-synthetic": Experiment(
        "go2",
        ("generate",),
        ("generate",),
        "the same on a quadruped of six times the weight",
        recipe=WALKS_MORE,
    ),
    "h1-human": Experiment(
        "h1",
        ("retarget", "track"),
        ("track",),
        "a person's motions, as the robot performs them",
        settings={"retarget": {"augment": True}},
        recipe={"train-low": BALANCE},
    ),
    "h1-synthetic": Experiment(
        "h1",
        ("generate",),
        ("generate",),
        "the same on the humanoid, whose low level is held to what experts answer",
        recipe={
            "train-low": {**BALANCE, **ANSWERED},
            "train-high": {
                "decisions": 5_000_000,
                "skill_dynamics.rounds": 8,
                "std": (0.1, 0.03),
            },
        },
    ),
}


def known(choices: dict[str, Any], name: str, what: str) -> Any:
    """The choice of that name.

    Raises:
        StageError: none has it; the message says what ``what`` may be.
    """
    if name not in choices:
        raise StageError(f"{what} '{name}': not known; use one of {', '.join(choices)}")
    return choices[name]
