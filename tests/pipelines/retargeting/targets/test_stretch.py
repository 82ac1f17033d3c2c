import numpy as np
import pytest

from lacoloco.datasets import rotations
from lacoloco.pipelines.retargeting.solve.pose_problem import JOINTS, TURN
from lacoloco.pipelines.retargeting.targets.stretch import turn_pull


def test_the_pull_makes_roughness_that_of_the_whole_orientation():
    rng = np.random.default_rng(1)
    weights = np.zeros(18)
    weights[TURN] = 2.0
    turns = 0.01 * rng.normal(size=(8, 3))
    steps = np.concatenate([[np.zeros(3)], 0.1 * rng.normal(size=(7, 3))])
    reference = [np.array([1.0, 0.0, 0.0, 0.0])]
    for step in steps[1:]:
        reference.append(rotations.multiply(reference[-1], rotations.exp_map(step)))
    pull = turn_pull(np.array(reference), weights)
    rough = np.diff(turns, 3, axis=0) + np.diff(steps[1:], 2, axis=0)
    constant = (np.diff(steps[1:], 2, axis=0) ** 2).sum()
    alone = (np.diff(turns, 3, axis=0) ** 2).sum()
    expected = 2.0 * ((rough**2).sum() - constant - alone)
    assert (pull[:, TURN] * turns).sum() == pytest.approx(expected)
    assert not pull[:, JOINTS].any()
