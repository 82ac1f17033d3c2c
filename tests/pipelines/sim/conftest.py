from dataclasses import replace

import pytest

from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.tasks import imitate_task


@pytest.fixture
def make_env(solo12):
    """Factory of Solo12 environments; keywords change the task."""

    def factory(task=None, worlds=4, seed=0, motions=None, **changes):
        task = task or imitate_task(solo12, constrained=False)
        return LeggedEnv(solo12, replace(task, **changes), worlds, seed=seed, motions=motions)

    return factory
