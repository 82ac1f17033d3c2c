"""Pictures as an MP4, which every browser, phone and slide shows.

PyAV brings the encoder with it; it is an extra, as only this needs it.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from lacoloco.pipelines.errors import StageError

QUALITY = {"crf": "20", "preset": "veryfast"}
"""Of x264: constant quality, at which no loss is seen, and little time spent on the last bytes."""


def check_mp4() -> None:
    """See whether MP4 can be written here at all, before the work rather than after it.

    Raises:
        StageError: It cannot; the message says what to install.
    """
    if find_spec("av") is None:
        raise StageError("an .mp4 needs PyAV; pip install 'lacoloco[video]', or name a .gif")


def encode_mp4(frames: Iterable[np.ndarray], fps: float) -> bytes:
    """Pictures as an H.264 film in an MP4.

    Args:
        frames: At least one of (height, width, 3) uint8, RGB, width and height even.
        fps: Of the film.

    Raises:
        StageError: PyAV is missing.
    """
    check_mp4()
    import av

    with TemporaryDirectory() as folder:
        file = Path(folder) / "film.mp4"  # a file: its index is moved to the front at the end
        with av.open(file, "w", format="mp4", options={"movflags": "faststart"}) as container:
            stream = None
            for frame in frames:
                if stream is None:
                    rate = Fraction(fps).limit_denominator(1000)
                    stream = container.add_stream("libx264", rate=rate, options=QUALITY)
                    stream.height, stream.width = frame.shape[:2]
                    stream.pix_fmt = "yuv420p"  # of all players; halves the colours' resolution
                picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")
                container.mux(stream.encode(picture))
            if stream is not None:
                container.mux(stream.encode())
        return file.read_bytes()
