"""Pictures as an animated GIF."""

from __future__ import annotations

from io import BytesIO

import numpy as np
from PIL import Image

SAMPLED = 16
"""Frames, evenly spread, from which the palette is chosen."""


def encode_gif(frames: np.ndarray, milliseconds: int, colours: int) -> bytes:
    """Pictures as a GIF that repeats for ever.

    One palette for all and no dithering: both would change pixels in which nothing moves, and what
    does not change costs no bytes.

    Args:
        frames: (N, height, width, 3) uint8, RGB.
        milliseconds: Between two frames; a multiple of 10.
        colours: Of the palette, at most 256.
    """
    chosen = np.linspace(0, len(frames) - 1, min(SAMPLED, len(frames))).astype(int)
    mosaic = Image.fromarray(np.concatenate(frames[chosen]))
    palette = mosaic.quantize(colours, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    images = [
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    ]
    file = BytesIO()
    images[0].save(
        file,
        "GIF",
        save_all=True,
        append_images=images[1:],
        duration=milliseconds,
        loop=0,
        optimize=False,
    )
    return file.getvalue()
