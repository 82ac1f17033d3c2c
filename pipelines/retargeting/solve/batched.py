"""CasADi functions of one frame, for many frames at once and without copies."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

CHUNK = 16
"""Frames per call: inputs and outputs stay in the cache, and few are computed in vain."""


class BatchedFunction:
    """A function of column vectors, mapped over frames; built once for clips of any length.

    Matrices may be sparse; what is known to be zero then costs nothing to compute.
    """

    def __init__(self, function: ca.Function) -> None:
        """Prepare the calls."""
        self._outputs = [function.sparsity_out(i) for i in range(function.n_out())]
        self._places = [
            None if pattern.is_dense() else np.array(pattern.find()) for pattern in self._outputs
        ]
        buffer: Any = function.map(CHUNK).buffer()  # CasADi's stubs describe other arguments
        self._buffer, self._run = buffer

    def __call__(self, *inputs: np.ndarray) -> list[np.ndarray]:
        """Evaluate N frames.

        Args:
            inputs: (N, size) each.

        Returns:
            (N, size) each; matrices are dense, column after column.
        """
        frames = len(inputs[0])
        padding = -frames % CHUNK
        padded = [np.concatenate([array, array[[-1] * padding]]) for array in inputs]
        results = [np.empty((frames + padding, pattern.nnz())) for pattern in self._outputs]
        for start in range(0, frames, CHUNK):
            chunk = slice(start, start + CHUNK)
            for index, array in enumerate(padded):
                self._buffer.set_arg(index, array[chunk].data)
            for index, array in enumerate(results):
                self._buffer.set_res(index, array[chunk].data)
            self._run()
        return [self._dense(index, array[:frames]) for index, array in enumerate(results)]

    def _dense(self, index: int, nonzeros: np.ndarray) -> np.ndarray:
        places = self._places[index]
        if places is None:
            return nonzeros
        values = np.zeros((len(nonzeros), self._outputs[index].numel()))
        values[:, places] = nonzeros
        return values
