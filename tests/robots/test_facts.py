"""The MJCFs against the published numbers they were written from (beside the checkout)."""

import json

import numpy as np
import pytest


def inertia(model, body):
    """Inertia of a body about its centre of mass in its own axes, (3, 3), kg.m2."""
    import mujoco

    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.body(body).iquat)
    rotation = rotation.reshape(3, 3)
    return rotation @ np.diag(model.body(body).inertia) @ rotation.T


@pytest.fixture
def facts(shared):
    def read(name):
        return json.loads((shared / "data" / "robots" / f"{name}_facts.json").read_text())

    return read


def test_solo12_has_the_masses_and_frames_of_its_urdf(facts, solo12):
    published, model = facts("solo12"), solo12.model()
    assert {model.body(i).name for i in range(1, model.nbody)} == {
        link["link"] for link in published["links"]
    }
    for link in published["links"]:
        body, i = model.body(link["link"]), link["inertia"]
        assert body.mass[0] == link["mass"], link["link"]
        np.testing.assert_array_equal(body.ipos, link["com"])
        expected = [
            [i["ixx"], i["ixy"], i["ixz"]],
            [i["ixy"], i["iyy"], i["iyz"]],
            [i["ixz"], i["iyz"], i["izz"]],
        ]
        np.testing.assert_allclose(inertia(model, link["link"]), expected, atol=1e-14)
    for joint in published["joints"]:
        np.testing.assert_array_equal(model.body(joint["child"]).pos, joint["origin_xyz"])
        if joint["type"] == "revolute":
            np.testing.assert_array_equal(model.joint(joint["joint"]).axis, joint["axis"])


def test_solo12_has_the_usable_joint_ranges(facts, solo12):
    published = facts("solo12")["usable_limits"]["position"]
    for i in range(12):
        joint = solo12.model().joint(i + 1)
        expected = published.get(joint.name, published["*_KFE"])
        np.testing.assert_array_equal(joint.range, expected)


def test_h1_has_the_masses_frames_and_ranges_of_menagerie(facts, h1):
    import mujoco

    model = h1.model()
    for row in facts("h1")["bodies"]:
        body, joint = model.body(row["body"]), row["joint"]
        assert body.mass[0] == row["mass"]
        np.testing.assert_array_equal(body.ipos, row["com"])
        rotation = np.zeros(9)
        quat = np.array(row["inertia_quat_wxyz"])
        mujoco.mju_quat2Mat(rotation, quat / np.linalg.norm(quat))
        rotation = rotation.reshape(3, 3)
        expected = rotation @ np.diag(row["diaginertia"]) @ rotation.T
        np.testing.assert_allclose(inertia(model, row["body"]), expected, atol=1e-12)
        if joint["type"] == "free":
            continue
        np.testing.assert_array_equal(body.pos, row["pos"])
        quat = np.array(row["quat_wxyz"])
        np.testing.assert_allclose(body.quat, quat / np.linalg.norm(quat), atol=1e-15)
        ours = model.joint(joint["name"])
        np.testing.assert_array_equal(ours.axis, joint["axis"])
        np.testing.assert_array_equal(ours.range, joint["range"])
        if not joint["name"].endswith("ankle"):  # 60 N.m as in the paper's code, not 40
            assert model.jnt_actfrcrange[ours.id, 1] == joint["effort"]
