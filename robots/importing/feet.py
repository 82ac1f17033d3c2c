"""A body per foot: one that is there already, or a new one that takes the foot's shapes."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree.ElementTree import SubElement

import numpy as np

from lacoloco.robots.importing.writing import numbers

if TYPE_CHECKING:
    import mujoco

    from lacoloco.robots.importing.kinematics import Leg
    from lacoloco.robots.importing.writing import Canonical


def give_feet_bodies(
    canonical: Canonical, model: mujoco.MjModel, data: mujoco.MjData, legs: list[Leg]
) -> list[str]:
    """Names of the bodies of the feet, in the order of the legs.

    A body that has nothing else to touch with is the foot. Where the foot's shapes are among those
    of the shank, or on several bodies, they move into a new body in their middle.

    Args:
        canonical: The MJCF of ``model``; gets the new bodies.
        model: The robot.
        data: Its kinematics in any pose.
        legs: Its legs.
    """
    return [_foot(canonical, model, data, leg) for leg in legs]


def _foot(canonical: Canonical, model: mujoco.MjModel, data: mujoco.MjData, leg: Leg) -> str:
    owners = {int(model.geom_bodyid[g]) for g in leg.geoms}
    if len(owners) == 1:
        (owner,) = owners
        own = [g for g in leg.limb.geoms if model.geom_bodyid[g] == owner]
        if set(own) == set(leg.geoms):
            return str(model.body(owner).name)
    end = model.body(leg.limb.end).name
    name = next(
        candidate
        for candidate in (f"{end}_{word}" for word in ("foot", "sole", "contact", "new_foot"))
        if candidate not in canonical.bodies
    )
    foot = SubElement(canonical.bodies[end], "body", name=name, pos=numbers(leg.centre))
    canonical.bodies[name] = foot
    for geom in leg.geoms:
        _move(canonical, model, data, geom, leg)
        element = canonical.bodies[model.body(model.geom_bodyid[geom]).name].find(
            f"geom[@name='{model.geom(geom).name}']"
        )
        assert element is not None, "every geom of the model was written"
        canonical.bodies[model.body(model.geom_bodyid[geom]).name].remove(element)
        foot.append(element)
    return name


def _move(
    canonical: Canonical, model: mujoco.MjModel, data: mujoco.MjData, geom: int, leg: Leg
) -> None:
    """Write the place of a geom in the frame of the new foot, which is turned as the shank is."""
    import mujoco

    owner = canonical.bodies[model.body(model.geom_bodyid[geom]).name]
    element = owner.find(f"geom[@name='{model.geom(geom).name}']")
    assert element is not None, "every geom of the model was written"
    shank = data.xmat[leg.limb.end].reshape(3, 3)
    pos = shank.T @ (data.geom_xpos[geom] - data.xpos[leg.limb.end]) - leg.centre
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, (shank.T @ data.geom_xmat[geom].reshape(3, 3)).ravel())
    element.set("pos", numbers(np.round(pos, 15)))
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_SPHERE:
        element.set("quat", numbers(quat))
    else:
        element.attrib.pop("quat", None)
