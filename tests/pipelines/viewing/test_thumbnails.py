"""Pictures of how held latents end."""

from __future__ import annotations

import numpy as np
import pytest

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.exploring import explorer
from lacoloco.pipelines.exploring.latent_map import HeldLatents
from lacoloco.pipelines.viewing import opengl
from lacoloco.pipelines.viewing.thumbnails import LOOK, draw_poses


@pytest.fixture
def held(solo12):
    """Two latents: one walks, one reaches; both end in the default pose."""
    motion = np.array([[0.5, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.3]])
    poses = np.tile(solo12.default_qpos(), (2, 1))
    return HeldLatents(np.eye(2), motion, motion[:, 0], np.zeros(2, dtype=bool), {}, poses)


def test_the_robot_is_drawn_where_it_ends_and_as_it_is_turned(solo12):
    try:
        opengl.check_gl()
    except StageError as error:
        pytest.skip(str(error))
    poses = np.tile(solo12.default_qpos(), (3, 1))
    poses[1, :2] = (30.0, -20.0)  # whole squares of the floor
    poses[2, 3:7] = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    here, far, turned = draw_poses(solo12, poses).astype(int)
    assert here.shape == (LOOK.height, LOOK.width, 3)
    dark = here.max(-1) < 90
    assert dark[LOOK.height // 4 :, LOOK.width // 4 : -LOOK.width // 4].sum() > 200
    assert np.abs(far - here).mean() < 3.0 < np.abs(turned - here).mean()


def test_the_whole_robot_is_in_the_picture(solo12):
    try:
        opengl.check_gl()
    except StageError as error:
        pytest.skip(str(error))
    poses = np.tile(solo12.default_qpos(), (3, 1))
    poses[1, 3:7] = (np.cos(0.35), 0.0, -np.sin(0.35), 0.0)  # it rears by 40 degrees
    poses[2, 3:7] = (np.cos(0.35), 0.0, np.sin(0.35), 0.0)
    poses[1:, 2] += 0.1
    dark = draw_poses(solo12, poses).max(-1) < 40  # trunk and feet; the floor is pale
    assert dark.sum((1, 2)).min() > 50
    assert not (dark[:, [0, -1]].any() or dark[:, :, [0, -1]].any())


def test_what_is_done_most_has_its_own_picture(solo12, held, monkeypatch):
    monkeypatch.setattr(explorer, "draw_poses", lambda spec, poses: np.arange(len(poses)))
    found = explorer.with_pictures(solo12, held, pytest.fail)
    assert [(one.name, picture) for one, picture in found] == [
        ("fastest forward", 0),
        ("reaches highest", 1),
        ("stands stillest", 2),
    ]


def test_without_opengl_the_list_has_no_pictures_and_says_why(solo12, held, monkeypatch):
    def refuse(*_):
        raise StageError("no OpenGL; install libegl1")

    monkeypatch.setattr(explorer, "draw_poses", refuse)
    said = []
    found = explorer.with_pictures(solo12, held, said.append)
    assert found and all(picture is None for _, picture in found)
    assert said == ["no pictures of what latents do: no OpenGL; install libegl1"]
