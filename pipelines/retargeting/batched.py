"""CasADi functions of one frame, for many frames at once and without copies."""

from __future__ import annotations

import casadi as ca
import numpy as np

CHUNK = 32
"""Frames per call: inputs and outputs stay in the cache, and few are computed in vain."""


class BatchedFunction:
    """A function of column vectors, mapped over frames; built once for clips of any length."""

    def __init__(self, function: ca.Function) -> None:
        """Prepare the calls."""
        self._outputs = [function.numel_out(i) for i in range(function.n_out())]
        self._buffer, self._run = function.map(CHUNK).buffer()

    def __call__(self, *inputs: np.ndarray) -> list[np.ndarray]:
        """Evaluate N frames.

        Args:
            inputs: (N, size) each.

        Returns:
            (N, size) each; matrices column after column.
        """
        frames = len(inputs[0])
        padding = -frames % CHUNK
        padded = [np.pad(array, ((0, padding), (0, 0)), mode="edge") for array in inputs]
        results = [np.empty((frames + padding, size)) for size in self._outputs]
        for start in range(0, frames, CHUNK):
            chunk = slice(start, start + CHUNK)
            for index, array in enumerate(padded):
                self._buffer.set_arg(index, memoryview(array[chunk]))
            for index, array in enumerate(results):
                self._buffer.set_res(index, memoryview(array[chunk]))
            self._run()
        return [array[:frames] for array in results]
