import numpy as np
import pytest

from lacoloco.datasets.motion_statistics import clip_statistics, library_statistics


def test_a_circle_has_the_numbers_of_a_circle(make_clip):
    contacts = np.zeros((60, 4), dtype=bool)
    contacts[:30] = True
    clip = make_clip(speed=0.5, skill="walk", contacts=contacts)
    row = clip_statistics(clip)
    assert (row["name"], row["skill"], row["fps"]) == ("circle", "walk", 50.0)
    seconds = 59 / 50
    assert row["seconds"] == pytest.approx(seconds)
    assert row["speed_mean_m_s"] == pytest.approx(0.5, abs=1e-4)
    assert row["forward_mean_m_s"] == pytest.approx(0.5, abs=1e-4)
    assert row["turning_mean_rad_s"] == pytest.approx(0.5, abs=1e-6)
    assert row["turned_rad"] == pytest.approx(0.5 * seconds, abs=1e-6)
    assert row["distance_m"] == pytest.approx(2 * np.sin(0.25 * seconds), abs=1e-6)
    assert row["height_min_m"] == row["height_max_m"] == pytest.approx(0.3)
    assert row["joint_speed_max_rad_s"] == pytest.approx(1.0, abs=1e-3)
    assert row["stance_share"] == 0.5


def test_groups_weigh_their_clips_by_seconds(make_clip):
    clips = [
        make_clip("slow", frames=101, speed=0.2, skill="walk"),
        make_clip("fast", frames=301, speed=0.6, skill="walk"),
        make_clip("still", frames=51, speed=0.0, skill="stand"),
    ]
    statistics = library_statistics(clips)
    walk, stand = statistics["skills"]
    assert (walk["skill"], walk["clips"], stand["clips"]) == ("walk", 2, 1)
    assert walk["seconds"] == pytest.approx(8.0)
    assert walk["speed_mean_m_s"] == pytest.approx((0.2 * 2 + 0.6 * 6) / 8, abs=1e-4)
    assert walk["turning_min_rad_s"] == pytest.approx(0.2, abs=1e-6)
    assert walk["turning_max_rad_s"] == pytest.approx(0.6, abs=1e-6)
    assert statistics["total"]["clips"] == 3
    assert statistics["total"]["seconds"] == pytest.approx(9.0)
    assert [row["stance_share"] for row in statistics["clips"]] == [None] * 3
