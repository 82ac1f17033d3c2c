"""The clips of a set as they are stored: all frames one after the other, with offsets.

A clip is a stretch of the rows of each array. What only some clips know has rows for those only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from lacoloco.datasets import series
from lacoloco.datasets.series import OPTIONAL

Rows = dict[str, np.ndarray]
"""The series of one clip by name, each (T, ...)."""

BLOCK = 1 << 16
"""Rows that are checked at a time, so that what is computed of them stays in the cache."""
_EXACT = "root_quat"
"""Kept in the precision that it has until it is stored: differences of it are taken."""
_OFFSETS = "offsets"
_KNOWN_BY = "{}_clips"


@dataclass(frozen=True)
class Known:
    """A series that only some of C clips have."""

    values: np.ndarray
    """(rows, width) of those clips, one after the other."""
    first: np.ndarray
    """(C,) int64 row where each clip begins, -1 for a clip that has none."""


@dataclass(frozen=True)
class FlatClips:
    """The series of C clips; nothing is checked before `problem` is asked."""

    series: Rows
    """Those of `series.SERIES`, each (rows, width)."""
    offsets: np.ndarray
    """(C + 1,) int64; clip c has the rows offsets[c] to offsets[c + 1]."""
    known: dict[str, Known] = field(default_factory=dict)
    """Those of `series.OPTIONAL` that at least one clip has."""

    @classmethod
    def of(cls, clips: Sequence[Rows], optional: Sequence[str] = OPTIONAL) -> FlatClips:
        """Lay clips out flat, all but orientations in single precision.

        Args:
            clips: the series of each.
            optional: those of `series.OPTIONAL` to take along, where some clip knows them.

        Raises:
            ValueError: their widths differ.
        """
        lengths = np.array([len(clip["root_pos"]) for clip in clips])
        rows = {
            name: np.concatenate([_single(clip[name]) for clip in clips])
            for name in series.SERIES
            if name != _EXACT
        }
        rows[_EXACT] = np.concatenate([clip[_EXACT] for clip in clips])
        known = {}
        for name in optional:
            having = [index for index, clip in enumerate(clips) if name in clip]
            if having:
                values = np.concatenate([_single(clips[index][name]) for index in having])
                known[name] = Known(values, _firsts(lengths, np.array(having)))
        return cls(rows, np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64), known)

    @classmethod
    def stored(cls, arrays: Mapping[str, np.ndarray], count: int) -> FlatClips:
        """The arrays of an artifact of `count` clips, as they are.

        Version 1 of the schema had an array per clip of what only some clips know.

        Raises:
            KeyError: an array is missing.
            ValueError: the offsets are no offsets, or rows are missing.
        """
        offsets = arrays[_OFFSETS]
        rising = offsets.shape == (count + 1,) and offsets.dtype.kind in "iu" and count > 0
        if not rising or offsets[0] != 0 or (np.diff(offsets.astype(np.int64)) <= 0).any():
            raise ValueError(f"the offsets are not those of {count} clips")
        lengths = np.diff(offsets)
        known = {}
        for name in series.OPTIONAL:
            if name in arrays:
                having = arrays[_KNOWN_BY.format(name)]
                values = arrays[name]
            else:
                single = [c for c in range(count) if f"{name}/{c}" in arrays]
                having = np.array(single, dtype=np.int64)
                values = np.concatenate([arrays[f"{name}/{c}"] for c in single] or [np.zeros(0)])
            if len(having):
                _check_known(name, values, having, lengths)
                known[name] = Known(values, _firsts(lengths, having))
        rows = {name: arrays[name] for name in series.SERIES}
        for name, values in rows.items():
            if values.ndim != 2 or len(values) != offsets[-1]:
                raise ValueError(f"{name} has shape {values.shape}, not {offsets[-1]} rows")
        return cls(rows, offsets.astype(np.int64), known)

    def to_store(self) -> dict[str, np.ndarray]:
        """The arrays of an artifact, by name."""
        arrays = {name: _single(values) for name, values in self.series.items()}
        arrays[_OFFSETS] = self.offsets
        for name, known in self.known.items():
            arrays[name] = known.values
            arrays[_KNOWN_BY.format(name)] = np.flatnonzero(known.first >= 0)
        return arrays

    def __len__(self) -> int:
        """Number of clips."""
        return len(self.offsets) - 1

    def rows(self, index: int) -> Rows:
        """The series of one clip, as views; what it does not know is not among them."""
        start, stop = self.offsets[index : index + 2].tolist()
        rows = {name: values[start:stop] for name, values in self.series.items()}
        for name, known in self.known.items():
            first = int(known.first[index])
            if first >= 0:
                rows[name] = known.values[first : first + stop - start]
        return rows

    def problem(self, joints: int) -> tuple[int, str]:
        """The first clip with something wrong, and what, in words; "" when nothing is.

        Args:
            joints: how many joints they should be for.
        """
        if self._is_sound(joints):
            return 0, ""
        found = ((c, series.problem(self.rows(c), joints)) for c in range(len(self)))
        return next(((index, text) for index, text in found if text), (0, ""))

    def _is_sound(self, joints: int) -> bool:
        """Whether all is right, for all clips at once: a clip at a time takes ten times as long."""
        for name, values in self._all():
            if name == "contacts":
                if values.dtype != bool or values.ndim != 2:
                    return False
                continue
            if values.ndim != 2 or values.shape[1] != series.width(name, joints):
                return False
            if not all(np.isfinite(block).all() for block in _blocks(values)):
                return False
        return all(series.are_unit(block) for block in _blocks(self.series["root_quat"]))

    def _all(self) -> Iterator[tuple[str, np.ndarray]]:
        yield from self.series.items()
        for name, known in self.known.items():
            yield name, known.values


def _single(values: np.ndarray) -> np.ndarray:
    """Bool stays bool, all else becomes single precision."""
    return values if values.dtype == bool else values.astype(np.float32, copy=False)


def _firsts(lengths: np.ndarray, having: np.ndarray) -> np.ndarray:
    first = np.full(len(lengths), -1, dtype=np.int64)
    first[having] = np.cumsum(lengths[having]) - lengths[having]
    return first


def _check_known(name: str, values: np.ndarray, having: np.ndarray, lengths: np.ndarray) -> None:
    whole = having.ndim == 1 and having.dtype.kind in "iu"
    inside = whole and having[0] >= 0 and having[-1] < len(lengths)
    if not inside or (np.diff(having.astype(np.int64)) <= 0).any():
        raise ValueError(f"{name} is not said to be of clips that there are")
    rows = int(lengths[having].sum())
    if values.ndim != 2 or len(values) != rows:
        raise ValueError(f"{name} has shape {values.shape}, not {rows} rows")


def _blocks(values: np.ndarray) -> Iterator[np.ndarray]:
    return (values[start : start + BLOCK] for start in range(0, len(values), BLOCK))
