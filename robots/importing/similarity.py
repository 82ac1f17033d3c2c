"""Numbers of a robot's trainings that follow from its size, weight, reach and gains.

Robots of one shape move alike when lengths are counted in standing heights h, speeds in sqrt(g h),
times in sqrt(h / g) and torques in m g h. The factors below were tuned on a quadruped of 0.31 m and
2.5 kg and a humanoid of 0.98 m and 51 kg and are without unit, but for where it says otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Numbers = dict[str, float | list[float]]


@dataclass(frozen=True)
class Size:
    """What the numbers follow from.

    Attributes:
        height: Of the base over the floor in standing, m.
        weight: N.
        gravity: m/s2.
        foot: (3,) the end effector in standing, relative to the floor under the base, m.
        reach: Length of its limb stretched out, from the joint that swings it forward, m.
        compliance: Of a leg's joints, the torque limit over the stiffness, rad.
    """

    height: float
    weight: float
    gravity: float
    foot: np.ndarray
    reach: float
    compliance: float

    @property
    def pace(self) -> float:
        """Unit of speed, m/s."""
        return float(np.sqrt(self.gravity * self.height))

    @property
    def second(self) -> float:
        """Unit of time, s."""
        return float(np.sqrt(self.height / self.gravity))


SWING_SPEED = 3.0
"""Speed of a joint whose motor's limit is not known, per unit of time: that of a fast swing."""


def common_numbers(size: Size) -> Numbers:
    """Placeholder -> number, for robots on any number of legs."""
    h, pace, second = size.height, size.pace, size.second
    return {
        "height": h,
        "noise_height": 0.016 * h,
        "noise_speed": 0.057 * pace,
        "noise_joint_speed": 0.27 / second,
        "walk_speed": 0.085 * pace,
        "reach_height": 0.48 * h,
        "not_reached": 0.95 * h,
        "no_progress": max(0.3 * h, float(size.foot[0])) + 0.65 * h,
        "height_error": 0.25 * h,
        "slow_speed": 0.455 * pace,
        "moving_speed": 0.114 * pace,
        "resting_speed": 0.0285 * pace,
        "resting_joint_speed": 0.054 / second,
        "joint_acceleration": 25.0 / second**2,
        "start_spread": 0.48 * h,
        "air_time": 1.1 * second,
        "narrow_variance": 0.0065 * pace**2,
        "variance": 0.081 * pace**2,
    }


def quadruped_numbers(size: Size) -> Numbers:
    """Placeholder -> number or range, for a robot that reaches with a foot."""
    h, pace, second, (x, y, _) = size.height, size.pace, size.second, size.foot
    outwards = np.sign(y) or -1.0
    inner, outer = y - outwards * 0.7 * size.reach, y + outwards * 0.28 * size.reach
    return {
        **common_numbers(size),
        # noise on actions shakes stiff legs and soft ones with the same share of their torque
        "action_scale": 2.0 * size.compliance,
        "walk_action_scale": 0.67 * size.compliance,
        "largest_action": max(1.0, 0.75 / size.compliance),
        "command_speed": 0.285 * pace,
        "push": 0.057 * pace,
        "strong_push": 0.142 * pace,
        "approach": 0.95 * h,
        "sharpness": 3.15 / h,
        "lift": 0.32 * h,
        # what hops on four strong legs tracks a velocity as well as what walks
        "vertical_motion_weight": 6.0 / pace**2,
        "joint_speed_weight": 0.0062 * second**2,
        "joint_torque_weight": 0.119 / (size.weight * h) ** 2,
        "radius": 4.75 * h,
        "reach_x": [x, x + 0.64 * size.reach],
        "reach_y": sorted([inner, outer]),
        "reach_z": [0.06 * h, 1.33 * h],
        "far_z": [0.5 * h, 1.33 * h],
    }


def biped_numbers(size: Size) -> Numbers:
    """Placeholder -> number or range, for a robot that reaches with a hand."""
    h, pace, second = size.height, size.pace, size.second
    side = np.sign(size.foot[1]) or -1.0
    return {
        **common_numbers(size),
        "variance": 0.026 * pace**2,
        "narrow_variance": 0.0031 * pace**2,
        "command_speed": 0.32 * pace,
        "push": 0.097 * pace,
        "fall_height": 0.665 * h,
        "gait_period": 2.53 * second,
        "gait_lift": 0.1 * h,
        "gait_stop_speed": 0.048 * pace,
        "gait_start_speed": 0.071 * pace,
        "close_feet": 0.184 * h,
        "joint_acceleration_weight": 3.35e-6 * second**4,
        "joint_torque_weight": 0.81 / (size.weight * h) ** 2,
        "approach": 0.31 * h,
        "near_approach": 0.082 * h,
        "sharpness": 10.0 / h,
        "reach_x": [0.36 * h, 0.61 * h],
        "reach_y": sorted([side * 0.41 * h, side * 0.05 * h]),
        "reach_z": [0.92 * h, 1.53 * h],
        "far_x": [0.31 * h, 4.1 * h],
        "far_y": [-1.02 * h, 1.02 * h],
        "far_z": [1.02 * h, 1.43 * h],
    }
