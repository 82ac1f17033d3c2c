"""Which episodes walk first and reach last, and which of them is typical."""

import numpy as np
import pytest

from lacoloco.pipelines.evaluation.skill_switching import Switching

WALK, REACH = 0, 1


@pytest.fixture
def make_switching():
    """Factory: one episode of 4 seconds per row of skills, one skill a second, 10 steps each."""

    def factory(seconds, fell=None, error=None):
        nearest = np.repeat(np.array(seconds, np.uint8), 10, axis=1)
        episodes, steps = nearest.shape
        ends = np.zeros(episodes) if error is None else np.array(error)
        return Switching(
            ("walk", "reach"),
            nearest,
            np.zeros((episodes, steps, 2)),
            np.broadcast_to(ends[:, None], (episodes, steps)),
            np.zeros(episodes, bool) if fell is None else np.array(fell),
            10.0,
        )

    return factory


def test_walking_first_and_reaching_last_by_hand(make_switching):
    found = make_switching(
        [
            [WALK, WALK, REACH, REACH],
            [WALK, REACH, WALK, REACH],
            [WALK, WALK, WALK, WALK],
            [REACH, WALK, WALK, REACH],
            [WALK, WALK, REACH, REACH],
        ],
        fell=[False, False, False, False, True],
    )
    assert found.switches.tolist() == [True, True, False, False, False]
    metrics = found.metrics()
    assert metrics["walk_first_reach_last"] == 0.4
    assert metrics["walk_first"] == 0.8
    assert metrics["reach_last"] == 0.8
    assert metrics["reach_steps"] == 0.4
    assert metrics["falls"] == 0.2


def test_a_second_takes_the_skill_of_most_of_its_steps(make_switching):
    found = make_switching([[WALK, WALK, WALK, REACH]])
    found.nearest[0, -10:-6] = WALK
    assert found.reaches_last[0]
    found.nearest[0, -6] = WALK
    assert not found.reaches_last[0], "five of ten are not most"


def test_what_is_shown_is_typical_of_the_episodes_that_switch(make_switching):
    switch, walk = [WALK, WALK, REACH, REACH], [WALK] * 4
    found = make_switching([walk, switch, switch, switch], error=[0.0, 0.9, 0.1, 0.3])
    assert found.typical() == 3
    assert make_switching([walk] * 3, error=[0.2, 0.1, 0.6]).typical() == 0
