"""What a policy observes: all that a laboratory measures, or what the robot has on board, and for
how many control steps.

A layout (see :func:`lacoloco.pipelines.sim.state.layout`) says it completely: which terms, of which
control step. An artifact keeps it, so that whatever plays the policy knows what to show it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

from lacoloco.datasets.config_values import Within
from lacoloco.pipelines.sim.state import Term

Measured = Literal["full", "onboard"]
LABORATORY = ("base_height", "base_lin_vel")
"""Terms that need motion capture or an estimator."""
RECORDED = (
    *("base_height", "projected_gravity", "base_lin_vel", "base_ang_vel", "joint_pos", "joint_vel"),
    *("last_action", "last_memory"),
)
"""Terms of which a history is kept; a command and the last latent are only those of now."""
PLACED = ("target", "heading_command")
"""Commands that the robot sees from where it is."""
BY_ODOMETRY = "base, by odometry"
"""Frame of these where the robot knows its way by its odometry only."""
ONBOARD_HISTORY = 6
"""Control steps, 0.12 s: more than one decision of the high level. Velocity has to be read off
them. Not chosen by measurement yet.
"""
LONGEST = 50


@dataclass(frozen=True)
class Observation:
    """What one policy observes.

    Attributes:
        onboard: Without the terms of :data:`LABORATORY`, commands by odometry.
        history: Control steps whose readings it sees, that of now included.
    """

    onboard: bool = False
    history: int = 1


FULL = Observation()


@dataclass(frozen=True)
class ObservationConfig:
    """What a policy and its critic observe.

    Attributes:
        measured: "full": also height and linear velocity of the base, as motion capture gives them.
            "onboard": IMU and joints only, and the target by an odometry that drifts. None: full;
            for a high level as its low level.
        history: Control steps whose readings the policy sees, that of now included. None: 6
            onboard, else 1.
        privileged_critic: The critic also sees the state without noise and the physical parameters
            of its world. None: onboard only.
    """

    measured: Measured | None = None
    history: Annotated[int, Within(1, LONGEST)] | None = None
    privileged_critic: bool | None = None

    def resolved(self, usual: Measured = "full") -> ObservationConfig:
        """With the defaults that follow from what is measured, ``usual`` unless it is said."""
        measured = self.measured or usual
        onboard = measured == "onboard"
        history, critic = self.history, self.privileged_critic
        return ObservationConfig(
            measured,
            (ONBOARD_HISTORY if onboard else 1) if history is None else history,
            onboard if critic is None else critic,
        )

    @property
    def of_policy(self) -> Observation:
        """What the policy observes."""
        told = self.resolved()
        return Observation(told.measured == "onboard", told.history or 1)


def observed_terms(terms: Sequence[Term], observation: Observation) -> tuple[Term, ...]:
    """Layout of a policy with this observation, from the layout ``terms`` of one that observes
    everything now: what it has of them, then the older readings, newest first.
    """
    now = tuple(terms)
    if observation.onboard:
        seen = (term for term in terms if term.name not in LABORATORY)
        now = tuple(_by_odometry(term) if term.name in PLACED else term for term in seen)
    recorded = [term for term in now if is_recorded(term)]
    ages = range(1, observation.history)
    return now + tuple(replace(term, steps_ago=age) for age in ages for term in recorded)


def is_recorded(term: Term) -> bool:
    """Whether a history of the term is kept."""
    return term.name in RECORDED


def observation_of(layout: Sequence[Mapping[str, Any]]) -> Observation:
    """What a policy with this stored layout observes.

    Raises:
        ValueError: No policy of this version has such a layout.
    """
    ages = [row.get("steps_ago", 0) for row in layout]
    if any(type(age) is not int or not 0 <= age < LONGEST for age in ages):
        raise ValueError(f"readings of {ages} control steps ago")
    names = [row["name"] for row in layout]
    onboard = "joint_pos" in names and not any(name in LABORATORY for name in names)
    return Observation(onboard, 1 + max(ages, default=0))


def _by_odometry(term: Term) -> Term:
    return replace(term, frame=BY_ODOMETRY)
