import numpy as np
import pytest

from lacoloco.pipelines.exploring.live import status_text
from lacoloco.pipelines.exploring.page import Page
from lacoloco.pipelines.exploring.server import local_server
from lacoloco.pipelines.exploring.world import ExploredWorld, rotated_to
from lacoloco.pipelines.learn.networks import NetworkConfig, make_actor
from lacoloco.pipelines.policies import Head, Policy
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.state import layout
from lacoloco.pipelines.sim.tasks import imitate_task


def test_a_latent_turned_to_a_value_stays_on_the_sphere_and_keeps_the_rest_in_proportion():
    turned = rotated_to(np.array([0.6, 0.8, 0.0]), 0, 0.0)
    assert turned == pytest.approx([0.0, 1.0, 0.0])
    turned = rotated_to(np.array([0.6, 0.48, 0.64]), 0, -0.8)
    assert turned == pytest.approx([-0.8, 0.36, 0.48])
    from_pole = rotated_to(np.array([1.0, 0.0, 0.0]), 0, 0.6)
    assert from_pole == pytest.approx([0.6, 0.8 / np.sqrt(2), 0.8 / np.sqrt(2)])


def test_the_robot_stands_up_again_where_it_began(make_world):
    world = make_world()
    start = world.qpos
    world.push(2.0)
    world.set_friction(0.3)
    latent = world.latent
    for _ in range(10):
        world.step()
    assert np.linalg.norm(world.qpos[:2] - start[:2]) > 0.1  # 0.2 s at 2 m/s
    world.reset()
    assert world.qpos == pytest.approx(start)
    assert world.friction == pytest.approx(0.3)
    assert world.latent == pytest.approx(latent)
    assert not world.fell


def test_a_low_level_alone_holds_its_latent_and_does_as_in_a_recording(make_world):
    """The recording is made by other code: the same start, latent and steps."""
    from lacoloco.datasets.published import resolve
    from lacoloco.pipelines.evaluation.rollout import record_low

    played = record_low(resolve("solo12-synthetic-low"), seconds=0.4, seed=3)
    world = make_world(seed=3)
    world.take(played.steering[0, 0])
    for qpos in played.qpos[0]:
        world.step()
        assert world.qpos == pytest.approx(qpos, abs=1e-5)
    assert world.latent == pytest.approx(played.steering[0, -1], abs=1e-6)


def test_a_high_level_steers_to_the_target_until_a_latent_is_taken(make_world):
    world = make_world("solo12-synthetic")
    assert world.has_target and world.high_steers
    world.set_target(np.array([0.3, 0.0, 0.3]))
    before = world.target_error
    for _ in range(150):
        world.step()
    assert world.target_error < 0.5 * before
    chosen = world.latent
    world.take(np.ones(world.dim))
    world.step()
    assert not world.high_steers
    assert world.latent == pytest.approx(np.ones(7) / np.sqrt(7))
    assert not np.allclose(world.latent, chosen)
    world.reset()
    assert world.target == pytest.approx([0.3, 0.0, 0.3])


def test_any_robot_can_be_explored_with_latents_of_any_width(robot):
    pytest.importorskip("viser")
    env = LeggedEnv(robot, imitate_task(robot, constrained=False), 1, seed=0)
    sizes, networks = {"policy": env.observe().shape[1], "latent": 3}, NetworkConfig(actor=(8,))
    actor = make_actor(sizes, env.num_actions, networks).eval()
    head = Head("low", sizes, env.num_actions, networks, layout(env.terms), "imitate")
    world = ExploredWorld({"low": Policy(head, actor)}, robot, None)
    with local_server() as server:
        page = Page(server, world, robot.name)
        assert len(page.sliders) == 3
        before = world.qpos
        page.ask(world.take_random)
        page.obey()
        world.step()
        page.draw()
        page.tell(status_text(world, world.frame[None].numpy(), 50.0))
        assert not np.allclose(world.qpos, before)
        assert "50 steps/s" in page.status.content
        assert [slider.value for slider in page.sliders] == pytest.approx(world.latent, abs=0.011)
