"""Which points of the recorded body belong to which bodies of the robot, limb by limb."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import Mocap
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.forward_kinematics import FREE_BASE, BodyPositions
from lacoloco.pipelines.retargeting.mocap.soles import SoleShape, recorded_feet, sole_shapes
from lacoloco.robots.spec import RobotSpec

_TYPO = 0.9
"""How alike a misspelt name and the right one are at least, see `difflib`."""


@dataclass(frozen=True)
class BodyMap:
    """The robot's K keypoints split into hips (where legs begin), points of feet, and arms.

    F legs are in the order of `RobotSpec.feet`, P points of feet in that of
    `RobotSpec.foot_points`: one for each leg, or the heels and the toes.
    """

    joints: tuple[str, ...]
    """Mocap joints of all keypoints, in their order."""
    hips: tuple[str, ...]
    """(F) mocap joints at which the legs begin."""
    feet: tuple[str, ...]
    """(P) mocap joints that stand for the points of the feet in the paper; of heels, the ankles."""
    hip_keypoints: tuple[int, ...]
    """(F) indices of the hips among the robot's keypoints."""
    foot_keypoints: tuple[int, ...]
    """(P) indices of the points of the feet among them."""
    legs: tuple[int, ...]
    """(P) which leg a point of a foot belongs to."""
    ends: tuple[tuple[str, ...], ...]
    """(P) nodes that touch the ground: the first that a file has."""
    arms: tuple[tuple[int, ...], ...] = ()
    """Indices of the keypoints of each limb that is no leg, from the trunk to its end."""
    soles: tuple[SoleShape, ...] = ()
    """(F) the robot's feet where they have a heel and toes; empty where they are single points."""

    @property
    def trunk(self) -> tuple[int, ...]:
        """Indices of the keypoints at which legs and arms begin."""
        return (*self.hip_keypoints, *(arm[0] for arm in self.arms))

    def limb_ends(self, mocap: Mocap) -> tuple[str, ...]:
        """The node of each of the P points of feet: what touches the ground, or its joint where the
        file has no other.

        Raises:
            DatasetError: The skeleton lacks a foot, or a node that is said to touch the ground.
        """
        mocap.keypoints(self.feet)
        if self.soles:
            return self.feet
        self._check_ends(mocap)
        return tuple(
            next((end for end in ends if end in mocap.joint_names), foot)
            for ends, foot in zip(self.ends, self.feet, strict=True)
        )

    def ground_nodes(self, mocap: Mocap) -> tuple[str, ...]:
        """Nodes of the file that are on the ground when a foot stands: not the ankles."""
        return self.limb_ends(mocap)[1::2] if self.soles else self.limb_ends(mocap)

    def foot_points(self, mocap: Mocap) -> np.ndarray:
        """(T, P, 3) what touches the ground, m: nodes, or heels below the ankles and toes."""
        nodes = mocap.keypoints(self.limb_ends(mocap))
        if not self.soles:
            return nodes
        feet = recorded_feet(nodes, mocap.keypoints(self.hips), self.soles)
        return np.stack([feet.heels, feet.toes], axis=2).reshape(nodes.shape)

    def keypoints(self, mocap: Mocap) -> np.ndarray:
        """(T, K, 3) joints of all keypoints, m; heels are below their ankles.

        Raises:
            DatasetError: The skeleton lacks a joint.
        """
        points = mocap.keypoints(self.joints)
        if self.soles:
            points[:, self.foot_keypoints] = self.foot_points(mocap)
        return points

    def standing(self, contacts: np.ndarray) -> np.ndarray:
        """(T, F) which feet stand, from which of their points do, (T, P) bool."""
        feet = [contacts[:, np.array(self.legs) == leg] for leg in range(len(self.hips))]
        return np.stack([points.any(axis=1) for points in feet], axis=1)

    def _check_ends(self, mocap: Mocap) -> None:
        """Refuse a misspelt node: without it another one is taken, and the scale changes."""
        named = {*self.hips, *self.feet, *(end for ends in self.ends for end in ends)}
        others = [joint for joint in mocap.joint_names if joint not in named]
        for ends in self.ends:
            # Files leave out ends of limbs; then those of their joints are meant.
            known = [end for end in ends if end.removesuffix("_end") in mocap.joint_names]
            for end in ends:
                likely = end not in mocap.joint_names and get_close_matches(end, others, 1, _TYPO)
                if likely or not known:
                    mocap.keypoints([end])

    def limbs(self, mocap: Mocap) -> list[tuple[str, ...]]:
        """The nodes of each leg from its hip down to the ground, or to the ankle above its heel.

        Raises:
            DatasetError: The skeleton lacks a hip or a foot, or one is not below the other.
        """
        mocap.keypoints(self.hips)
        ends = self.limb_ends(mocap)[:: 2 if self.soles else 1]
        return [_chain(mocap, hip, end) for hip, end in zip(self.hips, ends, strict=True)]

    def limb_length(self, mocap: Mocap) -> float:
        """From hips down to the ground along the bones, mean of the legs, m or units of the file.

        Raises:
            DatasetError: See `limbs`.
        """
        length = float(np.mean([bone_length(mocap, limb) for limb in self.limbs(mocap)]))
        if self.soles:
            nodes = mocap.keypoints(self.feet)
            bones = np.linalg.norm(nodes[:, 1::2] - nodes[:, ::2], axis=-1)
            length += 0.5 * float(np.median(bones))  # an ankle is half as high as the foot is long
        return length

    def pairs(self, mocap: Mocap, geometry: LegGeometry) -> tuple[tuple[str, str], ...]:
        """Nodes that belong to each other left and right.

        Raises:
            DatasetError: See `limbs`.
        """
        limbs = self.limbs(mocap)
        if self.soles:
            limbs = [
                (*limb, toe) for limb, toe in zip(limbs, self.ground_nodes(mocap), strict=True)
            ]
        pairs = limb_pairs(limbs, side_partners(geometry.hips))
        if self.arms:
            arms = [_chain(mocap, self.joints[arm[0]], self.joints[arm[-1]]) for arm in self.arms]
            roots = geometry.points[[arm[0] for arm in self.arms]]
            pairs += limb_pairs(arms, side_partners(roots))
        return pairs


@dataclass(frozen=True)
class LegGeometry:
    """Sizes of the robot that scaling needs, in its base frame."""

    hips: np.ndarray
    """(F, 3) where the legs begin, m."""
    feet: np.ndarray
    """(F, 3) the feet below them in the neutral pose, m: the ankles of feet with a heel."""
    points: np.ndarray
    """(K, 3) all keypoints in the neutral pose, m."""
    reach: float
    """Longest distance between a hip and the foot's point, or the sole below the ankle, m."""


def body_map(spec: RobotSpec, contacts: Mapping[str, Sequence[str]] | None = None) -> BodyMap:
    """Read the limbs off the robot's keypoints.

    Args:
        spec: The robot.
        contacts: Per foot of the robot, nodes that touch the ground; default: the end below the
            joint of its keypoint.

    Raises:
        StageError: A foot has no keypoint, or no keypoint at the root of its leg.
    """
    joints, names = list(spec.keypoints), list(spec.keypoints.values())
    bodies, _ = spec.located(names)
    hips, feet = [], []
    for point in spec.foot_points:
        body = spec.located([point])[0][0]
        trunk = _above(spec, body)[:-1]  # a keypoint of the base is no root of a leg
        above = [index for higher in trunk for index in _at(bodies, higher)]
        if point not in names or not above:
            raise StageError(
                f"robot '{spec.name}': retargeting needs keypoints for {point} and for a body at"
                " the root of its leg; write a map that has them and name it with --map"
            )
        hips.append(above[-1])
        feet.append(names.index(point))
    arms = _arms(spec, bodies, {*hips, *feet})
    if len({*hips}) < 3 and not arms:
        raise StageError(
            f"robot '{spec.name}': two legs do not tell how the trunk stands; give a map with"
            " keypoints where the arms begin, too"
        )
    legs = spec.foot_of_point
    hips = [hips[legs.index(leg)] for leg in range(len(spec.feet))]
    return BodyMap(
        joints=tuple(joints),
        hips=tuple(joints[i] for i in hips),
        feet=tuple(joints[i] for i in feet),
        hip_keypoints=tuple(hips),
        foot_keypoints=tuple(feet),
        legs=legs,
        ends=tuple(
            tuple((contacts or {}).get(point, (f"{joints[i]}_end",)))
            for point, i in zip(spec.foot_points, feet, strict=True)
        ),
        arms=arms,
        soles=sole_shapes(spec),
    )


def side_partners(roots: np.ndarray) -> list[int]:
    """For each limb, by where it begins (N, 3), the one on the other side of the robot."""
    mirrored = roots * [1.0, -1.0, 1.0]
    distance = np.linalg.norm(mirrored[:, None] - roots[None], axis=-1)
    return distance.argmin(1).tolist()


def limb_pairs(
    limbs: Sequence[Sequence[str]], partners: Sequence[int]
) -> tuple[tuple[str, str], ...]:
    """Nodes of limbs that belong to each other left and right.

    Args:
        limbs: Nodes of each limb from the hip down.
        partners: For each limb, the one on the other side.
    """
    pairs = []
    for index, partner in enumerate(partners):
        if index < partner:
            one, other = limbs[index], limbs[partner]
            if len(one) == len(other):
                pairs += list(zip(one, other, strict=True))
            else:  # at least what is followed and what stands
                pairs += [(one[0], other[0]), (one[-2], other[-2]), (one[-1], other[-1])]
    return tuple(pairs)


def bone_length(mocap: Mocap, limb: Sequence[str]) -> float:
    """Sum of the bones between the nodes of a limb, median over the clip, m."""
    bones = np.linalg.norm(np.diff(mocap.keypoints(limb), axis=1), axis=-1)
    return float(np.median(bones, axis=0).sum())


def leg_geometry(spec: RobotSpec, mapping: BodyMap) -> LegGeometry:
    """Measure the robot's legs with its own kinematics."""
    model, poses = spec.pinocchio_model(), _spread_poses(spec)
    ankles = [_above(spec, foot)[0] for foot in spec.feet] if mapping.soles else []
    bodies, offsets = spec.located([*spec.keypoints.values(), *ankles])
    assert poses.shape[1] == model.nq - FREE_BASE
    count, upright = len(poses), np.array([1.0, 0.0, 0.0, 0.0])
    positions = BodyPositions(model, bodies, offsets)
    points = positions(np.zeros((count, 3)), np.tile(upright, (count, 1)), poses)
    keypoints = len(spec.keypoints)
    hips = points[:, mapping.hip_keypoints]
    feet = points[:, keypoints:] if mapping.soles else points[:, mapping.foot_keypoints]
    reach = np.linalg.norm(feet - hips, axis=-1).max()
    below = max((sole.height for sole in mapping.soles), default=0.0)
    return LegGeometry(hips[0], feet[0], points[0, :keypoints], float(reach) + below)


def _above(spec: RobotSpec, body: str) -> list[str]:
    """Names of the bodies above a body, up to the base."""
    model, chain = spec.model(), [body]
    while model.body(chain[-1]).parentid[0] != 0:
        chain.append(model.body(model.body(chain[-1]).parentid[0]).name)
    return chain[1:]


def _at(bodies: Sequence[str], body: str) -> list[int]:
    return [index for index, other in enumerate(bodies) if other == body]


def _arms(spec: RobotSpec, bodies: Sequence[str], of_legs: set[int]) -> tuple[tuple[int, ...], ...]:
    """Chains of keypoints that belong to no leg, from the trunk to their ends.

    What several chains come from is one of its own.
    """
    _, offsets = spec.located(spec.keypoints.values())
    rest = [index for index in range(len(bodies)) if index not in of_legs]
    rest.sort(key=lambda index: (len(_above(spec, bodies[index])), np.linalg.norm(offsets[index])))
    parent = {}
    for place, index in enumerate(rest):
        above = [*_above(spec, bodies[index])[:-1], bodies[index]]  # but for the base
        parent[index] = next((k for k in reversed(rest[:place]) if bodies[k] in above), None)
    followers = list(parent.values())
    chains: list[list[int]] = []
    for index in rest:
        before = parent[index]
        if before is None or followers.count(before) > 1:
            chains.append([index])
        else:
            next(chain for chain in chains if chain[-1] == before).append(index)
    return tuple(tuple(chain) for chain in chains)


def _chain(mocap: Mocap, hip: str, end: str) -> tuple[str, ...]:
    """Names from hip to end, going up the parents."""
    names, index = [end], mocap.joint_names.index(end)
    while names[-1] != hip:
        index = mocap.parents[index]
        if index < 0:
            raise DatasetError(f"{mocap.name}: joint '{end}' is not below '{hip}'; mend the map")
        names.append(mocap.joint_names[index])
    return tuple(reversed(names))


def _spread_poses(spec: RobotSpec) -> np.ndarray:
    """The neutral pose, then every joint in turn through a full circle from all joints at zero."""
    angles = np.linspace(-np.pi, np.pi, 73)
    single = np.zeros((spec.num_joints, len(angles), spec.num_joints))
    for joint in range(spec.num_joints):
        single[joint, :, joint] = angles
    return np.concatenate([[spec.retarget_neutral], single.reshape(-1, spec.num_joints)])
