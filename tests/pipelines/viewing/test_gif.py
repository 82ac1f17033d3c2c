from io import BytesIO

import numpy as np
from PIL import Image

from lacoloco.pipelines.viewing.gif import encode_gif


def moving_square(count=5):
    """A red square on grey that moves 4 pixels per frame."""
    frames = np.full((count, 24, 40, 3), 150, dtype=np.uint8)
    for index, frame in enumerate(frames):
        frame[8:16, 4 * index : 4 * index + 8] = (220, 30, 40)
    return frames


def test_every_frame_is_there_in_its_colours():
    frames = moving_square()
    image = Image.open(BytesIO(encode_gif(frames, 80, 16)))
    assert (image.n_frames, image.size) == (5, (40, 24))
    assert image.info["duration"] == 80
    assert image.info["loop"] == 0
    for index, frame in enumerate(frames):
        image.seek(index)
        off = np.asarray(image.convert("RGB")).astype(int) - frame
        assert np.abs(off).max() <= 8
