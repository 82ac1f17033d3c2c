import pytest

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.mocap import load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.mocap.trim import trimmed

DOG = load_bvh(DOG_BVH)


@pytest.mark.parametrize(
    ("text", "start", "stop"),
    [
        ("", 0, 721),
        ("100:160", 100, 160),
        (":160", 0, 160),
        ("700:", 700, 721),
        ("700:9999", 700, 721),
        ("1s:2.5s", 60, 150),
        ("60:2.5s", 60, 150),
        (":", 0, 721),
    ],
)
def test_frames_and_seconds(text, start, stop):
    part = trimmed(DOG, text)
    assert part.frames == stop - start
    assert (part.positions == DOG.positions[start:stop]).all()


@pytest.mark.parametrize("text", ["5", "a:b", "1:2:3", "-5:3", "1.5:3", "s:2"])
def test_what_is_no_trim(text):
    with pytest.raises(StageError, match="--trim.*120:600"):
        trimmed(DOG, text)


@pytest.mark.parametrize("text", ["721:", "50:50", "20s:30s"])
def test_nothing_left_says_how_long_it_is(text):
    with pytest.raises(DatasetError, match=r"nothing is left of 721 frames \(12\.02 s\)"):
        trimmed(DOG, text)
