from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.viewing import opengl
from lacoloco.pipelines.viewing.robot_picture import HEIGHT, WIDTH, draw_robot


def test_looks_and_colliders_are_drawn_side_by_side(solo12):
    try:
        opengl.check_gl()
    except StageError as error:
        pytest.skip(str(error))
    picture = Image.open(BytesIO(draw_robot(solo12, solo12.default_qpos())))
    assert (picture.format, picture.size) == ("PNG", (2 * WIDTH, HEIGHT))
    halves = np.hsplit(np.asarray(picture.convert("RGB")).astype(int), 2)
    orange = [np.count_nonzero((h[..., 0] > 1.5 * h[..., 2]) & (h[..., 0] > 100)) for h in halves]
    assert orange[0] > 100 and orange[1] == 0  # the stripe on its back is only looked at
    dark = [np.count_nonzero(half.max(axis=2) < 80) for half in halves]
    assert min(dark) > 1000  # the trunk is seen in both
    border = np.concatenate([half[:, [0, -1]].reshape(-1, 3) for half in halves])
    assert border.min() > 100  # and nothing of the robot leaves the picture
