"""Pickles that do something when they are loaded; here they do nothing, and are refused."""

import collections
import io
import os
import pickle
import struct

import numpy as np
import pytest

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.foreign.pickles import read_pickle


@pytest.fixture
def written(tmp_path):
    def write(content, protocol=4):
        path = tmp_path / "motion.pkl"
        raw = content if isinstance(content, bytes) else pickle.dumps(content, protocol)
        path.write_bytes(raw)
        return path

    return write


class Calls:
    """Calls something when it is unpickled."""

    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_arrays_and_plain_containers_are_read(written, protocol):
    content = {
        "fps": np.float64(30.0),
        "count": np.int32(3),
        "single": np.arange(6, dtype=np.float32).reshape(2, 3),
        "fortran": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "big": np.arange(3, dtype=">i4"),
        "empty": np.zeros((0, 4)),
        "flags": np.array([True, False]),
        "list": [[1.0, 2], [3, 4]],
        "nested": {"text": "é", "none": None, "tuple": (1, np.ones(2))},
        "ordered": collections.OrderedDict(a=1),
    }
    read = read_pickle(written(content, protocol))
    assert set(read) == set(content)
    for name in ("single", "fortran", "big", "empty", "flags"):
        assert np.array_equal(read[name], content[name]) and read[name].shape == content[name].shape
    assert (read["fps"], read["count"], read["list"]) == (30.0, 3, content["list"])
    assert read["nested"]["text"] == "é" and read["nested"]["none"] is None
    assert np.array_equal(read["nested"]["tuple"][1], np.ones(2))
    assert read["ordered"] == {"a": 1}


@pytest.mark.parametrize("protocol", [0, 2, 4, 5])
@pytest.mark.parametrize(
    ("function", "arguments", "named"),
    [
        (os.mkdir, ("{}/broken_in",), "mkdir"),
        (os.system, ("mkdir {}/broken_in",), "system"),
        (eval, ("__import__('os').mkdir('{}/broken_in')",), "eval"),
        (exec, ("open('{}/broken_in', 'w')",), "exec"),
        (open, ("{}/broken_in", "w"), "open"),
        (np.savetxt, ("{}/broken_in", [1.0]), "savetxt"),
        (np.load, ("{}/broken_in",), "load"),
        (getattr, ("text", "upper"), "getattr"),
        (pickle.loads, (b"N.",), "loads"),
        (bytearray, (10**12,), "bytearray"),
    ],
)
def test_a_pickle_that_calls_something_is_refused(
    written, tmp_path, protocol, function, arguments, named
):
    arguments = [a.format(tmp_path) if isinstance(a, str) else a for a in arguments]
    path = written({"fps": 30, "frames": Calls(function, *arguments)}, protocol)
    with pytest.raises(DatasetError, match="nothing of it was executed") as caught:
        read_pickle(path)
    message = str(caught.value)
    assert named in message and str(path) in message and "\n" not in message
    assert not (tmp_path / "broken_in").exists()


def calling(module, name, arguments=b")"):
    """A pickle that calls a name with the arguments that some opcodes make."""
    return b"c" + f"{module}\n{name}\n".encode() + arguments + b"R."


ARRAY = b"cnumpy._core.multiarray\n_reconstruct\n)R"
HOSTILE = {
    "objects": pickle.dumps({"frames": np.array([1, "a", None], dtype=object)}),
    "records": pickle.dumps(np.zeros(2, dtype=[("a", "f4"), ("b", "O")])),
    "texts": pickle.dumps(np.array(["a"])),
    "dates": pickle.dumps(np.array(["2020-01-01"], dtype="M8[D]")),
    "sets": pickle.dumps({"a": {1, 2}}),
    "complex numbers": pickle.dumps(1j),
    "attribute of numpy": calling("numpy", "load"),
    "dotted name": b"\x80\x04\x8c\x05numpy\x8c\x07f2py.os\x93.",
    "module in disguise": b"\x80\x04\x8c\x0bnumpy.dtype\x8c\x07__new__\x93.",
    "outside": b"\x80\x04\x8c\x07storageQ.",
    "extension": b"\x80\x02\x82\x01.",
    "array of a text": ARRAY + b"(I1\n(I1\ntNI00\nVaaaa\ntb.",
    "array without a kind": ARRAY + b"(I1\n(I1\ntI7\nI00\nB" + struct.pack("<I", 1) + b"ab.",
    "kind that is a number": calling("numpy", "dtype", b"(I5\nt"),
    "kind of objects": calling("numpy", "dtype", b"(S'O8'\nI0\nI1\nt"),
    "state of a table": b"}(VK\nI1\ndb.",
    "cut short": pickle.dumps(np.ones(100))[:60],
    "empty": b"",
    "no pickle": b"PK\x03\x04 something else",
    "no end": b"\x80\x04" + b"]" * 50,
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_what_is_not_numbers_is_refused_in_one_line(written, kind):
    path = written(HOSTILE[kind])
    with pytest.raises(DatasetError) as caught:
        read_pickle(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_containers_within_themselves_end(written):
    endless: list = []
    endless.append({"again": endless})
    laughs: list = [[]]
    for _ in range(30):
        laughs = [laughs] * 30
    for content in (endless, {"a": laughs}):
        with pytest.raises(DatasetError, match="without end"):
            read_pickle(written(content))


def test_numbers_that_claim_more_than_there_is_are_refused(written):
    stream = io.BytesIO()
    pickle.dump(np.ones((2, 3)), stream, 2)
    raw = stream.getvalue().replace(b"K\x02K\x03\x86", b"J\xff\xff\xff\x7fK\x03\x86")
    assert raw != stream.getvalue()
    with pytest.raises(DatasetError):
        read_pickle(written(raw))
