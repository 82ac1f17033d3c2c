"""The picture of an episode that switches skills."""

import numpy as np

from lacoloco.pipelines.evaluation.rollout import ReachRecording
from lacoloco.pipelines.evaluation.skill_switching import Switching
from lacoloco.pipelines.plots import switching as plots


def test_the_picture_has_all_that_happened(tmp_path, monkeypatch):
    nearest = np.repeat([[0, 0, 1, 1]] * 2, 10, axis=1)
    found = Switching(
        ("walk", "reach"), nearest, np.zeros((2, 40, 2)), np.zeros((2, 40)), np.zeros(2, bool), 10.0
    )
    latent = np.zeros((2, 40, 7))
    latent[:, :, 2] = 1.0
    contact = np.zeros((2, 40, 4), bool)
    contact[:, 10:20, 0] = True
    empty = np.zeros((2, 40, 3))
    played = ReachRecording(
        qpos=empty,
        target=empty,
        end_effector=empty,
        contact=contact,
        steering=latent,
        low_obs=empty,
        latent=latent,
        high_obs=empty,
        frame=empty,
        action=empty,
        fell=found.fell,
        robot="solo12",
        fps=10.0,
    )
    kept = []
    monkeypatch.setattr(plots, "save", lambda figure, file: kept.append(figure))
    feet = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
    plots.draw_switching(tmp_path / "a.png", found, played, 1, feet)
    axes = kept[0].axes
    mesh = axes[0].collections[0].get_array()
    assert mesh.reshape(7, 40)[2].tolist() == [1.0] * 40
    assert [text.get_text() for text in axes[4].get_yticklabels()] == ["FL", "FR", "HL", "HR"]
    assert axes[4].collections[0].get_paths()[0].get_extents().intervalx.tolist() == [1.0, 2.0]
    assert "100.0% of 2 episodes" in kept[0].get_suptitle()
