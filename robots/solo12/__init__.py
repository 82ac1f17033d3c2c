"""Solo12: the numbers that MJCF has no place for. Frames, masses, limits: solo12.xml."""

from __future__ import annotations

from pathlib import Path

from lacoloco.robots.spec import EndEffector, RobotSpec

LEGS = ("FL", "FR", "HL", "HR")

# Dog skeleton of the SIGGRAPH 2018 mocap (MANN) -> bodies, as in the original's retargeting.
KEYPOINTS = {
    "LeftHand": "FL_FOOT",
    "RightHand": "FR_FOOT",
    "LeftFoot": "HL_FOOT",
    "RightFoot": "HR_FOOT",
    "LeftShoulder": "FL_SHOULDER",
    "RightShoulder": "FR_SHOULDER",
    "LeftUpLeg": "HL_SHOULDER",
    "RightUpLeg": "HR_SHOULDER",
}

PI = 3.141592653589793
# Bounds of the original's retargeting: HAA and HFE as the hardware, mirrored; KFE free (+-10 rad
# is the range of the MJCF, which no solution comes near).
HAA_BOUNDS = {"L": (-PI / 4, PI / 2), "R": (-PI / 2, PI / 4)}
HFE_BOUNDS = {"F": (-5 * PI / 4, PI / 2), "H": (-PI / 2, 5 * PI / 4)}
KFE_BOUNDS = (-10.0, 10.0)


def solo12() -> RobotSpec:
    """Solo12 as in the paper: 2.500 kg, 12 joints, 3 N.m.

    Sources: LaCoLoco's assets/odri.py for pose, gains, scales and limits; its retarget.py for the
    keypoints, the neutral pose and the bounds.
    """
    bounds = [b for leg in LEGS for b in (HAA_BOUNDS[leg[1]], HFE_BOUNDS[leg[0]], KFE_BOUNDS)]
    return RobotSpec(
        name="solo12",
        mjcf=Path(__file__).parent / "solo12.xml",
        joint_names=tuple(f"{leg}_{joint}" for leg in LEGS for joint in ("HAA", "HFE", "KFE")),
        default_joint_pos=(0.0, 0.4, -0.8) * 4,  # rad; the same sign front and hind
        stiffness=(4.0,) * 12,  # N.m/rad
        damping=(0.2,) * 12,  # N.m.s/rad
        action_scale=1.5,  # rad
        walk_action_scale=0.5,  # rad
        training_effort_limits=(4.5,) * 12,  # N.m, 1.5 x the motor's 3 ("MINIMAL")
        velocity_limits=(16.0,) * 12,  # rad/s, "MOTOR_LIMITS"; the URDF says 20
        end_effector=EndEffector("FR_FOOT"),
        feet=tuple(f"{leg}_FOOT" for leg in LEGS),
        fall_bodies=("base_link",),
        undesired_contact_bodies=tuple(f"{leg}_UPPER_LEG" for leg in LEGS),
        contact_force_limit=1.0,  # 25 N in the paper = the weight of this model, 24.5 N
        self_collision=True,
        keypoints=KEYPOINTS,
        retarget_neutral=(0.0, PI / 4, -PI / 2) * 4,  # rad
        retarget_lower=tuple(low for low, _ in bounds),
        retarget_upper=tuple(high for _, high in bounds),
        knee_frames=tuple(f"{leg}_LOWER_LEG" for leg in LEGS),  # origin = the knee
    )
