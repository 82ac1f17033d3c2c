"""How the fuzzing of readers alters sound inputs."""

from __future__ import annotations

import copy
import json
import random

import numpy as np

NASTY = (
    *("nan", "-inf", "1e999", "-1", "0", "5", "99999999999999999999", "0x1F", "-31,5", "1e-400"),
    *('"x"', "[]", "{}", "[[1], 2]", "true", "none", "null", '""', "'", '"""', "[a]", "[[a]]"),
    *("\0", "\ufeff", "\u00e9\u4e2d", "\t", "\r", "\n\n", "{", "}", "[", "]", "=", ".", "#"),
    *("[" * 5000, "{a=" * 3000, "a." * 3000, "9" * 6000, "x" * 5000, "_", "-", "..", "/", "~"),
)
JSON_VALUES = (
    *(None, True, 0, -1, 5, 2**70, 1e308, float("nan"), float("inf"), "", "x", "\0", "\ud800"),
    *([], [None], {}, {"a": 1}, [[[]]], "x" * 5000, 60_000, [60_000] * 5, "nan", "../../x"),
)


def mutated_text(text: bytes, chance: random.Random) -> bytes:
    """A text with one to four changes: of bytes, words, lines or numbers."""
    for _ in range(chance.randint(1, 4)):
        text = chance.choice(TEXT_CHANGES)(text, chance)
    return text


def _span(text: bytes, chance: random.Random) -> tuple[int, int]:
    first = chance.randrange(len(text) + 1)
    return first, min(len(text), first + chance.choice((1, 1, 2, 5, 20, 200)))


def _flip(text: bytes, chance: random.Random) -> bytes:
    altered = bytearray(text)
    for _ in range(chance.randint(1, 5)):
        if altered:
            altered[chance.randrange(len(altered))] ^= 1 << chance.randrange(8)
    return bytes(altered)


def _cut(text: bytes, chance: random.Random) -> bytes:
    first, last = _span(text, chance)
    return text[:first] + text[last:]


def _repeat(text: bytes, chance: random.Random) -> bytes:
    first, last = _span(text, chance)
    return text[:last] + text[first:last] * chance.choice((1, 2, 50)) + text[last:]


def _insert(text: bytes, chance: random.Random) -> bytes:
    place = chance.randrange(len(text) + 1)
    return text[:place] + chance.choice(NASTY).encode() + text[place:]


def _word(text: bytes, chance: random.Random) -> bytes:
    words = text.split(b" ")
    words[chance.randrange(len(words))] = chance.choice(NASTY).encode()
    return b" ".join(words)


def _lines(text: bytes, chance: random.Random) -> bytes:
    lines = text.split(b"\n")
    one, other = chance.randrange(len(lines)), chance.randrange(len(lines))
    kind = chance.randrange(4)
    if kind == 0:
        lines[one], lines[other] = lines[other], lines[one]
    elif kind == 1:
        del lines[one]
    elif kind == 2:
        lines.insert(one, lines[other])
    else:
        name, equals, _ = lines[one].partition(b"=")
        lines[one] = name + equals + b" " + chance.choice(NASTY).encode()
    return b"\n".join(lines)


def _end(text: bytes, chance: random.Random) -> bytes:
    return text[: chance.randrange(len(text) + 1)]


TEXT_CHANGES = (_flip, _flip, _cut, _repeat, _insert, _word, _word, _lines, _lines, _lines, _end)


def mutated_json(value: object, chance: random.Random) -> object:
    """A JSON value with one to three of its nodes exchanged, left out or added."""
    value = json.loads(json.dumps(value))
    for _ in range(chance.randint(1, 3)):
        nodes = [value]
        for node in nodes:
            inner = node.values() if isinstance(node, dict) else node
            nodes += [n for n in inner if isinstance(n, (dict, list)) and n]
        node = chance.choice(nodes)
        if not node:
            continue
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        key = chance.choice(keys)
        if chance.random() < 0.2:
            del node[key]
        elif chance.random() < 0.2 and isinstance(node, dict):
            node[chance.choice(("x", "", "kind", "\0"))] = copy.deepcopy(chance.choice(JSON_VALUES))
        else:
            node[key] = copy.deepcopy(chance.choice(JSON_VALUES))
    return value


def altered_arrays(arrays: dict[str, np.ndarray], chance: random.Random) -> dict[str, np.ndarray]:
    """The same arrays with one exchanged for an odd one, or left out."""
    name = chance.choice(list(arrays))
    odd = [np.zeros(0), np.array(3.0), np.full((5, 3), np.nan), np.arange(9)]
    odd.append(np.ones(3, dtype=bool))
    altered = {**arrays, name: chance.choice(odd)}
    if chance.random() < 0.3:
        del altered[name]
    return altered
