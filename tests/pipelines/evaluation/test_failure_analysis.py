"""Where failures cluster."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lacoloco.pipelines.evaluation.failure_analysis import (
    describe,
    episode_parameters,
    failure_clusters,
)
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.tasks import load_task

EPISODES = 400
FRICTION = np.linspace(0.4, 1.6, EPISODES + 1)[:-1]
ELSEWHERE = np.random.default_rng(0).permutation(np.linspace(0.8, 1.2, EPISODES))


def test_falls_on_grippy_floors_are_found_and_nothing_else():
    falls = np.zeros(EPISODES, dtype=bool)
    falls[[3, 150, *range(320, 400, 4)]] = True
    missed = np.zeros(EPISODES, dtype=bool)
    missed[::17] = True
    (cluster,) = failure_clusters(
        {"falls": falls, "not_reached": missed}, {"friction": FRICTION, "mass_scale": ELSEWHERE}
    )
    assert (cluster["failure"], cluster["parameter"], cluster["count"], cluster["of"]) == (
        "falls",
        "friction",
        20,
        22,
    )
    assert cluster["low"] == pytest.approx(1.3, abs=0.01)
    assert describe(cluster) == "falls: 20 of 22 in the quarter with friction 1.30 to 1.60"


def test_few_failures_or_a_parameter_that_never_differs_say_nothing():
    falls = np.zeros(EPISODES, dtype=bool)
    assert failure_clusters({"falls": falls}, {"friction": FRICTION}) == []
    falls[-4:] = True  # four in one quarter happen by chance
    assert failure_clusters({"falls": falls}, {"friction": FRICTION}) == []
    falls[:] = True
    assert (
        failure_clusters(
            {"falls": falls}, {"friction": FRICTION, "distance": np.full(EPISODES, 1.5)}
        )
        == []
    )


def test_what_differs_between_worlds(solo12):
    env = LeggedEnv(solo12, replace(load_task(solo12, "reach"), noise=0.0), 3, seed=0)
    env.state.root_pos[:, :2] = torch.tensor([[1.0, 2.0]])
    half = 0.5**0.5
    env.state.root_quat[:] = torch.tensor([half, 0.0, 0.0, half])  # looks along +y
    env.command[:] = torch.tensor([[1.0, 3.0, 0.25], [3.0, 2.0, 0.3], [1.0, 0.5, 0.2]])
    given = episode_parameters(env)
    torch.testing.assert_close(
        given["target_angle_deg"], torch.tensor([0.0, 90.0, 180.0]), atol=1e-3, rtol=0
    )
    torch.testing.assert_close(given["target_distance_m"], torch.tensor([1.0, 2.0, 1.5]))
    assert given["target_height_m"].tolist() == pytest.approx([0.25, 0.3, 0.2])
    assert given["friction"].data_ptr() == env.parameters.friction.data_ptr()
    assert set(map(len, given.values())) == {3}
