"""BVH files: their skeleton, their numbers, and where their nodes are.

No library reads what programs write: position channels on any joint, joints with fewer than three
channels, keywords in lower case, rows that are wrapped, comments on top, other encodings.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lacoloco.datasets.errors import DatasetError, storage_errors

ENCODINGS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
"""First bytes of a file -> its encoding. Without them it is UTF-8, or else Latin-1."""
COMMENT = ("#", "//", ";", "%")
"""What a line on top of a file may begin with, besides HIERARCHY."""
CHANNEL = re.compile(r"([xyz])(position|rotation)", re.IGNORECASE)
ROUND_RATE = 1e-4
"""Relative distance of a frame time from 1/N up to which N frames per second are meant."""


@dataclass
class Node:
    """A joint, or the end of a limb.

    Attributes:
        name: of the joint; the end below joint X is "X_end".
        parent: index of its parent, -1 for the root.
        offset: (3,) from its parent, in units of the file.
        positions: axis of each position channel -> its column.
        rotations: (axis, column) of each rotation channel, the outermost first.
    """

    name: str
    parent: int
    offset: np.ndarray | None = None
    positions: dict[int, int] = field(default_factory=dict)
    rotations: list[tuple[int, int]] = field(default_factory=list)


@dataclass(frozen=True)
class BvhFile:
    """What a file holds.

    Attributes:
        nodes: parents before children.
        frame_time: seconds.
        values: (T, channels) in units of the file and degrees.
        remarks: what was put up with, one line each.
    """

    nodes: tuple[Node, ...]
    frame_time: float
    values: np.ndarray
    remarks: tuple[str, ...] = ()

    def node_positions(self) -> np.ndarray:
        """(T, K, 3) positions of the nodes, in axes and units of the file.

        Position channels replace the OFFSET along their axes; rotations apply in the file's order.
        """
        frames = len(self.values)
        points = np.empty((frames, len(self.nodes), 3))
        turns: list[np.ndarray] = []
        for index, node in enumerate(self.nodes):
            local = np.broadcast_to(_offset(node), (frames, 3)).copy()
            for axis, column in node.positions.items():
                local[:, axis] = self.values[:, column]
            turn = np.broadcast_to(np.eye(3), (frames, 3, 3))
            if node.parent >= 0:
                turn = turns[node.parent]
                local = points[:, node.parent] + np.einsum("tij,tj->ti", turn, local)
            points[:, index] = local
            for axis, column in node.rotations:
                turn = turn @ _about(axis, np.deg2rad(self.values[:, column]))
            turns.append(turn)
        return points


def parse_bvh(path: Path) -> BvhFile:
    """Read a file.

    Raises:
        DatasetError: It cannot be read, or is no BVH; the message names the file and the line.
    """
    lines = _lines(path)
    starts = [n for n, line in enumerate(lines) if line.strip().upper() == "MOTION"]
    if not starts:
        raise DatasetError(f"{path}: is cut short, it has no line MOTION")
    nodes, channels = _Hierarchy(path).read(lines[: starts[0]])
    frames, frame_time, first = _motion_header(path, lines, starts[0] + 1)
    values = _numbers(path, lines, first, channels)
    remark = _frame_count(path, frames, len(values))
    rate = round(1.0 / frame_time)
    if rate and abs(1.0 / rate - frame_time) < ROUND_RATE * frame_time:
        frame_time = 1.0 / rate
    return BvhFile(nodes, frame_time, values, remark)


def _lines(path: Path) -> list[str]:
    """The lines from HIERARCHY on; those before are blanked."""
    with storage_errors(path, "read"):
        content = path.read_bytes()
    if not content.strip():
        raise DatasetError(f"{path}: the file is empty")
    text = _decoded(content).rstrip("\x1a\x00 \r\n\t")
    lines = text.splitlines()
    for number, line in enumerate(lines):
        word = line.strip()
        if word.upper() == "HIERARCHY":
            return [""] * (number + 1) + lines[number + 1 :]
        if word and not word.startswith(COMMENT):
            break
    raise DatasetError(f"{path}: not a BVH file, it does not begin with HIERARCHY")


def _decoded(content: bytes) -> str:
    named = next((code for mark, code in ENCODINGS.items() if content.startswith(mark)), "utf-8")
    try:
        return content.decode(named)
    except UnicodeDecodeError:
        return content.decode("latin-1")


class _Hierarchy:
    """Reads the skeleton line by line; braces may stand anywhere."""

    def __init__(self, path: Path) -> None:
        self.path, self.line = path, 0
        self.nodes: list[Node] = []
        self.names: set[str] = set()
        self.open: list[int] = []
        self.next: Node | None = None
        self.columns = 0

    def read(self, lines: list[str]) -> tuple[tuple[Node, ...], int]:
        """The nodes, and the number of channels."""
        for number, line in enumerate(lines, 1):
            self.line = number
            for part in re.split(r"([{}])", line):
                if words := part.split():
                    self._take(words)
        if self.open or self.next is not None:
            raise self._wrong("is cut short: a brace is not closed before MOTION")
        if not self.nodes:
            raise self._wrong("has no ROOT")
        return tuple(self.nodes), self.columns

    def _take(self, words: list[str]) -> None:
        keyword = words[0].upper()
        if keyword in ("ROOT", "JOINT", "END"):
            self._begin(keyword, " ".join(words[1:]))
        elif keyword == "{":
            if self.next is None:
                raise self._wrong("a brace opens after no ROOT, JOINT or End Site")
            self.open.append(len(self.nodes))
            self.nodes.append(self.next)
            self.next = None
        elif keyword == "}":
            if not self.open:
                raise self._wrong("a brace closes that was never opened")
            node = self.nodes[self.open.pop()]
            if node.offset is None:
                raise self._wrong(f"{node.name!r} has no OFFSET")
        elif keyword in ("OFFSET", "CHANNELS") and self.open and self.next is None:
            node = self.nodes[self.open[-1]]
            (self._offset if keyword == "OFFSET" else self._channels)(node, words[1:])
        else:
            raise self._wrong(f"{' '.join(words)[:40]!r} has no place here")

    def _begin(self, keyword: str, name: str) -> None:
        if self.next is not None:
            raise self._wrong(f"{self.next.name!r} has no opening brace")
        if not self.open and (keyword != "ROOT" or self.nodes):
            raise self._wrong(f"{keyword} {name}: a skeleton has one ROOT, and all else within it")
        if keyword == "ROOT" and self.open:
            raise self._wrong(f"ROOT {name} lies within another joint")
        parent = self.open[-1] if self.open else -1
        if keyword == "END":
            name = f"{self.nodes[parent].name}_end"
            while name in self.names:
                name += "_"
        if not name:
            raise self._wrong(f"a {keyword} has no name")
        if name in self.names:
            raise self._wrong(f"two joints have the same name {name!r}; rename one")
        self.names.add(name)
        self.next = Node(name, parent)

    def _offset(self, node: Node, words: list[str]) -> None:
        numbers = [_number(word) for word in words]
        if len(numbers) != 3 or None in numbers:
            text = " ".join(words)[:40]
            raise self._wrong(f"OFFSET {text}: three numbers are needed{_about_commas(text)}")
        node.offset = np.array(numbers, dtype=float)

    def _channels(self, node: Node, words: list[str]) -> None:
        found = [CHANNEL.fullmatch(word) for word in words[1:]]
        named = [(("xyz").index(m[1].lower()), m[2].lower()) for m in found if m is not None]
        if not words or words[0] != str(len(named)) or len(named) != len(found):
            raise self._wrong(
                f"CHANNELS {' '.join(words)[:60]}: a count and as many of Xposition ... Zrotation"
            )
        for axis, kind in named:
            if kind == "position":
                node.positions[axis] = self.columns
            else:
                node.rotations.append((axis, self.columns))
            self.columns += 1

    def _wrong(self, what: str) -> DatasetError:
        return DatasetError(f"{self.path}: line {self.line}: {what}")


def _motion_header(path: Path, lines: list[str], first: int) -> tuple[int, float, int]:
    """Declared frames, frame time [s], and the index of the first row."""
    found: dict[str, str] = {}
    number = first
    while number < len(lines) and len(found) < 2:
        key, colon, value = lines[number].partition(":")
        key = " ".join(key.upper().split())
        if colon and key in ("FRAMES", "FRAME TIME"):
            found[key] = value.strip()
        elif lines[number].strip():
            break
        number += 1
    if len(found) < 2:
        raise DatasetError(f"{path}: line {number + 1}: after MOTION come Frames: and Frame Time:")
    frames, frame_time = _number(found["FRAMES"]), _number(found["FRAME TIME"])
    if frames is None or frames != frames // 1 or frames < 0:
        raise DatasetError(f"{path}: Frames: {found['FRAMES']!r} is no whole number")
    if frame_time is None or not 0 < frame_time < np.inf:
        hint = _about_commas(found["FRAME TIME"])
        raise DatasetError(
            f"{path}: Frame Time: {found['FRAME TIME']!r} is no positive number of seconds{hint}"
        )
    return int(frames), frame_time, number


def _numbers(path: Path, lines: list[str], first: int, channels: int) -> np.ndarray:
    """(T, channels); a row may be wrapped over several lines."""
    if not channels:
        raise DatasetError(f"{path}: none of its joints has a channel, so nothing moves")
    words = " ".join(lines[first:]).split()
    try:
        flat = np.array(words, dtype=float)
    except ValueError:
        raise _no_number(path, lines, first) from None
    frames, left = divmod(len(flat), channels)
    if left:
        raise DatasetError(
            f"{path}: is cut short: its last row has {left} of {channels} numbers;"
            " remove that row, or restore the file"
        )
    return flat.reshape(frames, channels)


def _no_number(path: Path, lines: list[str], first: int) -> DatasetError:
    number, word = next(
        (n, word)
        for n, line in enumerate(lines[first:], first + 1)
        for word in line.split()
        if _number(word) is None
    )
    return DatasetError(f"{path}: line {number}: {word[:40]!r} is no number{_about_commas(word)}")


def _about_commas(text: str) -> str:
    return "; write numbers with a point" if "," in text else ""


def _frame_count(path: Path, declared: int, found: int) -> tuple[str, ...]:
    if not found or not declared:
        raise DatasetError(f"{path}: has zero frames")
    if abs(declared - found) > 1:
        raise DatasetError(
            f"{path}: declares {declared} frames but holds {found}; is it cut short?"
        )
    if declared != found:
        return (f"declares {declared} frames and holds {found}: all {found} are taken",)
    return ()


def _number(word: str) -> float | None:
    """The number that a word is; None if it is none. `nan` and `inf` are numbers here."""
    try:
        return float(word)
    except ValueError:
        return None


def _offset(node: Node) -> np.ndarray:
    return np.zeros(3) if node.offset is None else node.offset


def _about(axis: int, angle: np.ndarray) -> np.ndarray:
    """(T, 3, 3) rotations about an axis by ``angle`` (T,) rad."""
    turn = np.zeros((len(angle), 3, 3))
    one, other = (axis + 1) % 3, (axis + 2) % 3
    with np.errstate(invalid="ignore"):  # what is not finite is named by the reader
        cos, sin = np.cos(angle), np.sin(angle)
    turn[:, axis, axis] = 1.0
    turn[:, one, one], turn[:, one, other] = cos, -sin
    turn[:, other, one], turn[:, other, other] = sin, cos
    return turn
