import mujoco
import numpy as np
import pytest

from lacoloco.robots.errors import RobotError
from lacoloco.robots.geometry import colliding_geoms, lowest_point, standing_height

SHAPES = """
<mujoco>
  <compiler angle="degree"/>
  <worldbody>
    <geom name="sphere" type="sphere" size="0.1" pos="0 0 1"/>
    <geom name="upright" type="capsule" size="0.1 0.3" pos="0 0 1"/>
    <geom name="lying" type="capsule" size="0.1 0.3" pos="0 0 1" euler="90 0 0"/>
    <geom name="leaning" type="capsule" size="0.1 0.3" pos="0 0 1" euler="60 0 0"/>
    <geom name="can" type="cylinder" size="0.1 0.3" pos="0 0 1" euler="0 30 0"/>
    <geom name="box" type="box" size="0.1 0.2 0.3" pos="0 0 1" euler="0 90 0"/>
    <geom name="floor" type="plane" size="1 1 1"/>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def shapes():
    model = mujoco.MjModel.from_xml_string(SHAPES)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


@pytest.mark.parametrize(
    ("name", "extent"),
    [
        ("sphere", 0.1),
        ("upright", 0.4),
        ("lying", 0.1),
        ("leaning", 0.1 + 0.3 * 0.5),
        ("can", 0.3 * np.cos(np.pi / 6) + 0.1 * np.sin(np.pi / 6)),
        ("box", 0.1),
    ],
)
def test_lowest_point(shapes, name, extent):
    model, data = shapes
    assert lowest_point(model, data, model.geom(name).id) == pytest.approx(1 - extent, abs=1e-12)


def test_a_plane_has_no_lowest_point(shapes):
    model, data = shapes
    with pytest.raises(RobotError, match="PLANE"):
        lowest_point(model, data, model.geom("floor").id)


def test_standing_height_follows_the_pose(solo12):
    straight = standing_height(solo12.model(), np.zeros(12), solo12.feet)
    assert straight == pytest.approx(2 * 0.16 + 0.02, abs=1e-12)


def test_a_body_without_collider_and_an_unknown_one_are_named(solo12):
    with pytest.raises(RobotError, match="FL_SHOULDER"):
        colliding_geoms(solo12.model(), ["FL_SHOULDER"])
    with pytest.raises(RobotError, match="tail"):
        colliding_geoms(solo12.model(), ["tail"])
