from pathlib import Path

import pytest

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.mocap.selection import load_selection, shipped_selections


def test_the_papers_selection_is_22_minutes_of_41_clips():
    selection = load_selection("paper-dogs")
    assert shipped_selections() == ["paper-dogs"]
    assert len(selection.trims) == 41
    assert selection.trims["D1_031_KAN01_001"] == "511:960"
    assert selection.trims["D1_007_KAN01_001"] == ""
    # of the 24 clips with trims: 79,472 frames less the 17 whole recordings, by hand
    spans = [map(int, trim.split(":")) for trim in selection.trims.values() if trim]
    whole = [
        592,
        3237,
        5097,
        817,
        855,
        4685,
        1053,
        2750,
        4335,
        3593,
        547,
        3843,
        4576,
        547,
        154,
        202,
    ]
    whole += [359, 747, 5355]
    assert sum(stop - start for start, stop in spans) == 79_472 - sum(whole)


def test_files_are_chosen_by_name_in_the_order_of_the_selection(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("[clips]\nb = [2, 5]\na = []\nc = []\n")
    selection = load_selection(str(path))
    files = [Path("x/a.bvh"), Path("x/b.BVH"), Path("y/a.bvh"), Path("x/d.bvh")]
    assert selection.chosen(files) == [(files[1], "2:5"), (files[0], "")]
    assert selection.absent(files) == ["c"]


def test_an_unknown_selection_names_the_known_ones():
    with pytest.raises(StageError, match="--select cats: .*paper-dogs"):
        load_selection("cats")


@pytest.mark.parametrize(
    "text",
    [
        "[clips]\n",
        "clips = 3",
        "[clips]\na = [5, 2]",
        "[clips]\na = [1]",
        "[clips]\na = [0.5, 2]",
        "[clips",
    ],
)
def test_what_is_no_selection(tmp_path, text):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(StageError, match="--select"):
        load_selection(str(path))
