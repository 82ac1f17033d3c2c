"""Which metrics of a training belong into one panel, in which unit, and what to compare them
with.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Line:
    """One metric: its name in the log (a trailing ``*`` takes all that begin so), its label, and a
    factor to the unit.
    """

    metric: str
    label: str = ""
    factor: float = 1.0
    band: tuple[str, str] | None = None
    """Metrics between which the panel is shaded."""


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    title: str
    unit: str
    lines: tuple[Line, ...]
    references: tuple[Line, ...] = ()
    """Metrics of the clips, drawn as dotted lines, since they do not change in training."""
    level: tuple[float, str] | None = None
    """A value to compare with, and its name."""
    log: bool = False
    limits: tuple[float, float] | None = None


PER_SECOND = 50.0
"""Rewards are logged per control step of 0.02 s."""
LEARNER = (
    Panel("Step of the policy", "KL per minibatch [nat]", (Line("kl"),)),
    Panel("Learning rate of the actor", "Adam's step size", (Line("learning_rate"),), log=True),
    Panel(
        "Critic, explained variance",
        "share of the returns",
        (Line("explained_variance"),),
        limits=(-0.2, 1.0),
    ),
    Panel("Critic, value loss", "squared error of the return", (Line("value"),), log=True),
)
"""Panels of PPO, the same for every training."""

LOW = (
    Panel(
        "Style reward",
        "per step, before weights",
        (Line("imitation_reward", "imitation"), Line("encoder_reward", "skill encoder")),
        level=(0.693, "undecided discriminator"),
    ),
    Panel(
        "Discriminator, accuracy",
        "% right",
        (
            Line("agent_accuracy", "on the policy", 100.0),
            Line("demo_accuracy", "on the clips", 100.0),
        ),
        level=(50.0, "blind"),
        limits=(0.0, 100.0),
    ),
    Panel("Discriminator, margin", "clips - policy [logits]", (Line("margin"),)),
    Panel(
        "Do latents steer?",
        "cosine, loss",
        (Line("encoder_cosine", "encoder cosine"), Line("diversity", "diversity loss")),
        limits=(-0.1, 1.1),
    ),
    Panel(
        "Skills from a standing start, no noise",
        "% of latents",
        (
            Line("coverage_walk", "walk", 100.0),
            Line("coverage_reach", "reach", 100.0),
            Line("coverage_fall", "fall", 100.0),
            Line("coverage_clips", "clips reproduced", 100.0),
        ),
        references=(Line("clips_walk", "clips", 100.0), Line("clips_reach", "", 100.0)),
        limits=(0.0, 100.0),
    ),
    Panel(
        "Cells of velocity and height",
        "% of what the clips show",
        (
            Line("coverage_cells", "reached by a latent", 100.0),
            Line("coverage_turn_left", "latents that turn left", 100.0),
            Line("coverage_turn_right", "right", 100.0),
        ),
        references=(
            Line("clips_cells", "as many moments of clips", 100.0),
            Line("clips_turn_left", "", 100.0),
        ),
        limits=(0.0, 100.0),
    ),
    Panel(
        "Speed of the base",
        "m/s",
        (
            Line("speed", "in training"),
            Line(
                "coverage_speed_p50",
                "standing start: median, 10-90 %",
                band=("coverage_speed_p10", "coverage_speed_p90"),
            ),
        ),
        references=(Line("clips_speed_p50", "clips"),),
    ),
    Panel(
        "Lift of the end effector",
        "cm",
        (
            Line(
                "coverage_lift",
                "standing start: mean, 10-90 %",
                100.0,
                ("coverage_lift_p10", "coverage_lift_p90"),
            ),
        ),
        references=(Line("clips_lift", "clips", 100.0),),
    ),
    Panel("Falls", "per 1000 steps", (Line("falls_per_1000_steps"),)),
    Panel(
        "Constraints",
        "% of steps",
        (Line("violation_*", "above limit:", 100.0), Line("delta", "terminated (delta)", 100.0)),
    ),
    Panel("Constraints, c_max", "N above the limit", (Line("c_max_foot_force", "foot force"),)),
    Panel("Exploration", "std [raw action]", (Line("std"),)),
    *LEARNER,
)
HIGH = (
    Panel("Distance at the end of an episode", "cm", (Line("final_error", "", 100.0),)),
    Panel("Task reward", "per second", (Line("reward", "", PER_SECOND),)),
    Panel("Falls", "% of episodes", (Line("falls_per_episode", "", 100.0),)),
    Panel(
        "Contact forces above the limit",
        "% of foot-substeps",
        (Line("contact_violation", "", 100.0),),
    ),
    Panel("Speed of the base", "m/s", (Line("speed"),)),
    Panel(
        "Latents in use, resultant", "|mean latent|", (Line("latent_resultant"),), limits=(0.0, 1.0)
    ),
    Panel("Latents in use, directions", "dimensions", (Line("latent_directions"),)),
    Panel("Exploration", "std [raw latent]", (Line("std"),)),
    *LEARNER,
)
EXPERTS = (
    Panel("Task reward", "per second", (Line("reward", "", PER_SECOND),)),
    Panel("Walking, velocity error", "m/s", (Line("velocity_error"),)),
    Panel("Walking, yaw error", "rad/s", (Line("yaw_error"),)),
    Panel("Reaching, target error", "cm", (Line("target_error", "", 100.0),)),
    Panel("Falls", "per 1000 steps", (Line("falls_per_1000_steps"),)),
    Panel("Constraints", "% terminated (delta)", (Line("delta", "", 100.0),)),
    Panel("Exploration", "std [raw action]", (Line("std"),)),
    *LEARNER,
)
TRACK = (
    Panel("Likeness to the clips", "reward, 0 to 1", (Line("reward"),), limits=(0.0, 1.0)),
    Panel("Clips lost", "per 1000 steps", (Line("lost_per_1000_steps"),)),
    Panel("Falls", "per 1000 steps", (Line("falls_per_1000_steps"),)),
    Panel("Constraints", "% of steps", (Line("violation_*", "above limit:", 100.0),)),
    Panel("Exploration", "std [raw action]", (Line("std"),)),
    *LEARNER,
)
PANELS = {"experts": EXPERTS, "track": TRACK, "train-low": LOW, "train-high": HIGH}
TITLES = {
    "experts": "Experts",
    "track": "Tracker",
    "train-low": "Low level",
    "train-high": "High level",
}
