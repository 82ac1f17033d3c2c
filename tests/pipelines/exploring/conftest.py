import threading
from contextlib import contextmanager

import pytest

from lacoloco.datasets.published import resolve
from lacoloco.pipelines.exploring.world import ExploredWorld
from lacoloco.pipelines.policies import load_policies, task_of
from lacoloco.pipelines.robot import robot_of


@pytest.fixture
def make_world():
    """Factory of a world of a published policy."""

    def make(name="solo12-synthetic-low", seed=0):
        artifact, policies = load_policies(resolve(name), "low")
        spec = robot_of(artifact)
        task = task_of(artifact, spec) if "high" in policies else None
        return ExploredWorld(policies, spec, task, seed=seed)

    return make


@pytest.fixture
def live():
    """A context in which a world is stepped and shown; gives the address of its page."""
    pytest.importorskip("viser")
    from lacoloco.pipelines.exploring.live import run
    from lacoloco.pipelines.exploring.page import Page
    from lacoloco.pipelines.exploring.server import local_server

    @contextmanager
    def shown(world):
        with local_server() as server:
            page, stop = Page(server, world, "tried"), threading.Event()
            loop = threading.Thread(target=run, args=(world, page, stop))
            loop.start()
            try:
                yield f"http://{server.get_host()}:{server.get_port()}/", page
            finally:
                stop.set()
                loop.join()

    return shown
