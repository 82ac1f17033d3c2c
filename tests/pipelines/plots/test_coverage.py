"""The picture of what latents reach of the clips."""

from dataclasses import replace

import pytest
import torch

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation.skill_cells import CellCoverage, SkillCells
from lacoloco.pipelines.plots import coverage as plot


@pytest.fixture
def found():
    cells = SkillCells(0.15, 0.4, 0.1)
    clips = torch.tensor([[0.3, 0.0, 0.0, 0.0]] * 9 + [[0.0, 0.0, 0.8, 0.2]])
    return CellCoverage(cells, clips, torch.tensor([[0.3, 0.0, 0.0, 0.0], [9.0, 0, 0, 0]]), 4)


@pytest.fixture
def figure(found, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(plot, "save", lambda figure, file: drawn.append(figure))
    plot.draw_coverage(tmp_path / "a.png", found)
    return drawn[0]


def test_clips_stand_above_latents_on_the_edges_of_cells(figure):
    clips, latents = figure.axes[0], figure.axes[3]
    reached, lost = (line.get_ydata() for line in clips.lines)
    assert (len(reached), len(lost)) == (9, 1)
    assert clips.get_ylim() == pytest.approx((-0.45, 0.75)), "cells 0 and 1, and one beyond"
    assert clips.get_yticks(minor=True) == pytest.approx([-0.45, -0.15, 0.15, 0.45, 0.75])
    assert latents.lines[0].get_ydata() == pytest.approx([0.3, 0.75]), "far off: at the border"
    assert "reach 90%" in figure.get_suptitle()
    assert "2 fell" in figure.get_suptitle()


def test_the_picture_is_written_even_if_all_fell(found, tmp_path):
    plot.draw_coverage(tmp_path / "a.png", replace(found, latents=torch.zeros(0, 4)))
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(StageError, match=r"\.png"):
        plot.draw_coverage(tmp_path / "a.doc", found)
