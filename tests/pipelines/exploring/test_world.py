import numpy as np
import pytest

from lacoloco.pipelines.exploring.world import rotated_to


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
