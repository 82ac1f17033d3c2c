"""How stiff legs have to be for a robot to stand by its gains alone: tried out.

A formula for one leg does not say it. Feet creep apart under the weight, and the more a leg is bent
the more it gives way.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from lacoloco.robots.importing.gains import propose_gains
from lacoloco.robots.importing.proposal import Facts, write_toml
from lacoloco.robots.loading import TOML, robot_from_files
from lacoloco.robots.stance import Stance, stand

if TYPE_CHECKING:
    import mujoco

    from lacoloco.robots.spec import RobotSpec

FIRM = 0.05
"""Share of its height by which a robot may sag."""
STEPS = (1.1, 1.4)
"""Least and largest factor on the stiffness from one try to the next."""
BRIEFLY = 2.0
"""s after which a robot that is too soft has sagged too far already."""
STIFFEST = 16.0
"""Factor beyond which stiffness is not what is missing."""


def stand_firmly(facts: Facts, final: mujoco.MjModel, text: str, name: str) -> tuple[Facts, Stance]:
    """Stiffen what carries the robot until it stands for ten seconds and sags by ``FIRM`` at most.

    Returns:
        The facts with those gains, and how it stands with them. Where no stiffness will do, as for
        most robots on two legs, the facts are those that came, and the stance is theirs.

    Args:
        facts: What was found out about the robot.
        final: The robot as it is written.
        text: The same, as its MJCF.
        name: Of the robot.
    """
    tried, firmness = facts, 1.0
    (least, most), stance = STEPS, _try(facts, final, text, name)
    while not _firm(stance):
        wanted = most if stance.fell else min(max(stance.sag / FIRM, least), most)
        firmness *= wanted
        if firmness > STIFFEST:
            return facts, stand(_robot(facts, final, text, name))
        gains = propose_gains(facts.model, facts.legs, facts.angles, facts.efforts, firmness)
        tried = replace(facts, gains=gains)
        stance = _try(tried, final, text, name)
    return tried, stance


def _try(facts: Facts, final: mujoco.MjModel, text: str, name: str) -> Stance:
    robot = _robot(facts, final, text, name)
    stance = stand(robot, BRIEFLY)
    return stand(robot) if _firm(stance) else stance


def _firm(stance: Stance) -> bool:
    return not stance.fell and stance.sag <= FIRM


def _robot(facts: Facts, final: mujoco.MjModel, text: str, name: str) -> RobotSpec:
    toml, _ = write_toml(facts, final, name)
    return robot_from_files({TOML: toml, f"{name}.xml": text}, Path(name))
