"""Cells of velocities and heights: how wide they are, and what of the clips latents reach."""

from dataclasses import replace

import pytest
import torch

from lacoloco.pipelines.evaluation.skill_cells import CellCoverage, SkillCells, turn_speed

CELLS = SkillCells(walk_speed=0.15, turn_speed=0.4, reach_height=0.1)


def test_cells_by_hand():
    """Velocities: 0 is between the thresholds, the next cells are as wide. Lift: from 0 up."""
    motion = torch.tensor(
        [
            [0.14, -0.14, 0.39, 0.09],
            [0.16, -0.16, -0.41, 0.11],
            [0.44, -0.46, 1.19, 0.39],
            [-0.8, 0.0, 1.21, -0.05],
        ]
    )
    expected = [[0, 0, 0, 0], [1, -1, -1, 1], [1, -2, 1, 3], [-3, 0, 2, 0]]
    assert CELLS.index(motion).tolist() == expected


def test_edges_lie_where_the_number_of_a_cell_changes():
    for axis in range(4):
        for edge in CELLS.edges(axis, 0, 2)[1:]:
            motion = torch.zeros(2, 4)
            motion[:, axis] = torch.tensor([edge - 1e-3, edge + 1e-3])
            below, above = CELLS.index(motion)[:, axis].tolist()
            assert above == below + 1
    assert CELLS.edges(0, -1, 0) == pytest.approx([-0.45, -0.15, 0.15])
    assert CELLS.edges(3, 0, 1) == pytest.approx([0.0, 0.1, 0.2])


def test_widths_follow_from_the_robot(solo12):
    """Its own thresholds; it turns from half of the +-0.78 rad/s that it is asked for on."""
    assert SkillCells.of(solo12) == SkillCells(0.15, 0.39, 0.15)
    faster = replace(solo12, skills=replace(solo12.skills, walk_speed=0.6, reach_height=0.3))
    assert SkillCells.of(faster).widths == pytest.approx((1.2, 1.2, 0.78, 0.3))


def test_a_robot_without_a_walking_task_turns_by_its_size(solo12):
    silent = replace(solo12, tasks={})
    assert turn_speed(silent) == pytest.approx(0.15 / solo12.default_height())
    straight = {**solo12.tasks["walk"]}
    straight["command"] = {**straight["command"], "yaw_rate": [0.0, 0.0]}
    straight["rewards"] = []
    tasks = {"walk": straight}
    assert turn_speed(replace(solo12, tasks=tasks)) == turn_speed(silent)


def test_words_for_a_cell():
    assert CELLS.describe((0, 0, 0, 0)) == "standing"
    assert CELLS.describe((1, 0, -1, 0)) == "forward 0.3 m/s, turning right 0.8 rad/s"
    words = "backward 0.6 m/s, to the left 0.3 m/s, end effector up 0.2 m or more"
    assert CELLS.describe((-2, 1, 0, 2)) == words


@pytest.fixture
def coverage():
    """Six moments walk on, three turn left, one right; of four latents one walks on, one turns
    left, one does what no clip shows, one fell.
    """
    on, left, right = [0.3, 0.0, 0.0, 0.0], [0.3, 0.0, 0.8, 0.0], [0.3, 0.0, -0.8, 0.0]
    return CellCoverage(
        CELLS,
        clips=torch.tensor([on] * 6 + [left] * 3 + [right]),
        latents=torch.tensor([[0.2, 0.1, 0.1, 0.02], [0.4, 0.0, 1.0, 0.0], [0.0, 0.6, 0.0, 0.0]]),
        held=4,
    )


def test_the_clips_moments_are_weighted_by_use(coverage):
    metrics = coverage.metrics()
    assert metrics["coverage_cells"] == pytest.approx(0.9)
    assert coverage.reached().tolist() == [True] * 9 + [False]
    assert coverage.lost() == [
        ("forward 0.3 m/s, turning right 0.8 rad/s", pytest.approx(0.1)),
    ]


def test_as_many_moments_of_the_clips_miss_some_cells_by_chance(coverage):
    """Each of four finds a cell of share p with p: 0.6 (1 - 0.4^4) + 0.3 (1 - 0.7^4) + ..."""
    expected = 0.6 * (1 - 0.4**4) + 0.3 * (1 - 0.7**4) + 0.1 * (1 - 0.9**4)
    assert coverage.metrics()["clips_cells"] == pytest.approx(expected)


def test_turning_is_counted_to_both_sides_and_those_that_fall_turn_nowhere(coverage):
    metrics = coverage.metrics()
    assert metrics["clips_turn_left"] == pytest.approx(0.3)
    assert metrics["clips_turn_right"] == pytest.approx(0.1)
    assert metrics["coverage_turn_left"] == pytest.approx(0.25)
    assert metrics["coverage_turn_right"] == 0.0


def test_if_all_fall_nothing_is_reached(coverage):
    fell = replace(coverage, latents=torch.zeros(0, 4))
    assert fell.metrics()["coverage_cells"] == 0.0
    assert [share for _, share in fell.lost()] == pytest.approx([0.6, 0.3, 0.1])
