import socket
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.exploring.live import Pace
from lacoloco.pipelines.exploring.server import check_viser, local_server


def test_fifty_steps_a_second_are_made_up_for_after_a_short_delay_and_not_after_a_long_one():
    now, slept = [0.0], []

    def sleep(seconds):
        slept.append(seconds)
        now[0] += seconds

    pace = Pace(lambda: now[0], sleep)
    for work in (0.005, 0.025, 0.005, 1.0, 0.005):
        now[0] += work
        pace.wait()
    # due at 20, 40, 60 ms; then a second late, after which the next is due 20 ms later
    assert slept == pytest.approx([0.015, 0.01, 0.015])
    assert pace.rate == pytest.approx(4 / (now[0] - 0.02))


def test_the_page_is_served_on_this_machine_only_and_opens_no_tunnel():
    pytest.importorskip("viser")
    with local_server() as server:
        assert server.get_host() == "127.0.0.1"
        assert server.request_share_url() is None
        with socket.create_connection(("127.0.0.1", server.get_port()), timeout=5):
            pass


def test_a_port_that_is_taken_is_refused():
    pytest.importorskip("viser")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(StageError, match=f"--port {port}"), local_server(port):
            pass


def test_without_viser_one_line_says_how_to_install_it(monkeypatch):
    monkeypatch.setattr("lacoloco.pipelines.exploring.server.find_spec", lambda name: None)
    with pytest.raises(StageError, match=r"pip install 'lacoloco\[explore\]'"):
        check_viser()


def test_a_robot_is_shown_as_mujoco_draws_it():
    pytest.importorskip("viser")
    from lacoloco.pipelines.viewing.live_robot import LiveRobot

    model = mujoco.MjModel.from_xml_string(
        """<mujoco><asset><material name="red" rgba="1 0 0 1"/></asset><worldbody>
        <body><freejoint/><geom name="looks" size="1" material="red" contype="0" conaffinity="0"/>
        <geom name="touches" size="1" group="3"/></body></worldbody></mujoco>"""
    )
    spec = SimpleNamespace(model=lambda: model, default_qpos=lambda: model.qpos0)
    added = {}
    scene = SimpleNamespace(
        add_frame=lambda name, **_: SimpleNamespace(),
        add_mesh_simple=lambda name, *_, color, **__: added.update({name: color}),
    )
    LiveRobot(SimpleNamespace(scene=scene), spec)
    assert added == {"/world/robot/1/0": (255, 0, 0)}


def test_every_kind_of_geom_becomes_triangles_of_its_size():
    pytest.importorskip("trimesh")
    from lacoloco.pipelines.viewing.live_robot import geom_mesh

    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody>
        <geom type="box" size="1 2 3"/><geom type="sphere" size="2"/>
        <geom type="ellipsoid" size="1 2 3"/><geom type="cylinder" size="1 2"/>
        <geom type="capsule" size="1 2"/><geom type="plane" size="1 1 1"/>
        </worldbody></mujoco>"""
    )
    highest = [(1, 2, 3), (2, 2, 2), (1, 2, 3), (1, 1, 2), (1, 1, 3)]
    for geom, expected in enumerate(highest):
        vertices = geom_mesh(model, geom).vertices
        assert np.abs(vertices).max(axis=0) == pytest.approx(expected, rel=0.03)
        assert np.abs(vertices.max(axis=0) + vertices.min(axis=0)).max() < 0.05
    assert geom_mesh(model, 5) is None
