"""Unitree H1: the numbers that MJCF has no place for. Frames, masses, limits: h1.xml."""

from __future__ import annotations

from pathlib import Path

from lacoloco.robots.spec import EndEffector, RobotSpec

# Per joint: default pose rad, kp N.m/rad, kd N.m.s/rad, training torque N.m, speed rad/s, range
# rad. Pose, gains and training torque ("MINIMAL"): LaCoLoco's assets/unitree.py. Speed: its
# "MOTOR_LIMITS", equal to h1.urdf of unitree_ros. Range: h1.xml, repeated for the retargeting.
LEG = {
    "hip_yaw": (0.0, 150.0, 5.0, 300.0, 23.0, (-0.43, 0.43)),
    "hip_roll": (0.0, 150.0, 5.0, 300.0, 23.0, (-0.43, 0.43)),
    "hip_pitch": (-0.28, 200.0, 5.0, 300.0, 23.0, (-1.57, 1.57)),
    "knee": (0.79, 200.0, 5.0, 300.0, 14.0, (-0.26, 2.05)),
    "ankle": (-0.52, 20.0, 4.0, 100.0, 9.0, (-0.87, 0.52)),
}
TORSO = {"torso": (0.0, 200.0, 5.0, 300.0, 23.0, (-2.35, 2.35))}
LEFT_ARM = {
    "shoulder_pitch": (0.28, 40.0, 10.0, 300.0, 9.0, (-2.87, 2.87)),
    "shoulder_roll": (0.0, 40.0, 10.0, 300.0, 9.0, (-0.34, 3.11)),
    "shoulder_yaw": (0.0, 40.0, 10.0, 300.0, 20.0, (-1.3, 4.45)),
    "elbow": (0.52, 40.0, 10.0, 300.0, 20.0, (-1.25, 2.61)),
}
RIGHT_ARM = {
    **LEFT_ARM,
    "shoulder_roll": (*LEFT_ARM["shoulder_roll"][:5], (-3.11, 0.34)),
    "shoulder_yaw": (*LEFT_ARM["shoulder_yaw"][:5], (-4.45, 1.3)),
}


def h1() -> RobotSpec:
    """Unitree H1 as in the paper: 51.437 kg, 19 joints, no self collision."""
    joints = {
        **{f"left_{name}": row for name, row in LEG.items()},
        **{f"right_{name}": row for name, row in LEG.items()},
        **TORSO,
        **{f"left_{name}": row for name, row in LEFT_ARM.items()},
        **{f"right_{name}": row for name, row in RIGHT_ARM.items()},
    }
    pose, stiffness, damping, effort, speed, ranges = zip(*joints.values(), strict=True)
    return RobotSpec(
        name="h1",
        mjcf=Path(__file__).parent / "h1.xml",
        joint_names=tuple(joints),
        default_joint_pos=pose,
        stiffness=stiffness,
        damping=damping,  # besides the 1 N.m.s/rad of joint damping in h1.xml
        action_scale=1.5,  # rad
        walk_action_scale=0.5,  # rad
        training_effort_limits=effort,
        velocity_limits=speed,
        end_effector=EndEffector("right_elbow_link", (0.3, 0.0, 0.0)),  # m, along the forearm
        feet=("left_FOOT", "right_FOOT"),
        fall_bodies=("torso_link",),
        undesired_contact_bodies=(),
        contact_force_limit=1.5,  # the paper's 1080 N = 1.5 x the 720 N its code takes as weight
        self_collision=False,
        retarget_neutral=pose,  # no mocap is retargeted to H1
        retarget_lower=tuple(low for low, _ in ranges),
        retarget_upper=tuple(high for _, high in ranges),
        knee_frames=("left_knee_link", "right_knee_link"),
    )
