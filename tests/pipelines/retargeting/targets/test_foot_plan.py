import numpy as np
import pytest

from lacoloco.pipelines.retargeting.targets.foot_plan import CLEARANCE, plan_feet

RADIUS, FPS = 0.02, 60.0


@pytest.fixture
def walk():
    """One foot that stands (sliding and sinking a little), swings 0.3 m on, and stands again."""
    place = np.concatenate(
        [np.linspace(0, 0.01, 20), np.linspace(0.05, 0.3, 20), np.full(20, 0.32)]
    )
    height = np.concatenate(
        [np.full(20, 0.015), 0.02 + 0.06 * np.sin(np.linspace(0, np.pi, 20)), np.full(20, 0.02)]
    )
    feet = np.stack([place, 0 * place, height], axis=-1)[:, None]
    contacts = np.repeat([True, False, True], 20)[:, None]
    return feet, contacts


def test_a_standing_foot_stays_where_it_stood_on_average(walk):
    feet, contacts = walk
    plan = plan_feet(feet, contacts, RADIUS, FPS)
    np.testing.assert_allclose(plan.path[:20, 0], np.tile([0.005, 0, RADIUS], (20, 1)))
    np.testing.assert_allclose(plan.path[40:, 0], np.tile([0.32, 0, RADIUS], (20, 1)))


def test_a_swing_leaves_and_arrives_at_rest(walk):
    feet, contacts = walk
    path = plan_feet(feet, contacts, RADIUS, FPS).path[:, 0]
    step = np.linalg.norm(np.diff(path, axis=0), axis=1)
    raw = np.linalg.norm(np.diff(feet[:, 0], axis=0), axis=1)
    assert step[19] < 0.6 * raw[19]
    assert step[39] < raw[39]
    assert (
        np.abs(np.diff(path, 2, axis=0)).max() < 0.7 * np.abs(np.diff(feet[:, 0], 2, axis=0)).max()
    )


def test_a_swing_keeps_its_shape_in_the_middle(walk):
    feet, contacts = walk
    path = plan_feet(feet, contacts, RADIUS, FPS).path
    np.testing.assert_allclose(path[29:31], feet[29:31], atol=2e-3)


def test_a_dragging_foot_is_lifted_clear(walk):
    feet, contacts = walk
    feet[20:40, 0, 2] = 0.0
    plan = plan_feet(feet, contacts, RADIUS, FPS)
    assert plan.path[..., 2].min() >= RADIUS
    assert plan.path[29:31, 0, 2].min() == pytest.approx(RADIUS + CLEARANCE, abs=1e-3)


@pytest.mark.parametrize("standing", [True, False])
def test_a_foot_that_never_changes(walk, standing):
    feet, contacts = walk
    plan = plan_feet(feet, np.full_like(contacts, standing), RADIUS, FPS)
    if standing:
        np.testing.assert_allclose(plan.path - plan.path[:1], 0.0, atol=1e-12)
    else:
        np.testing.assert_allclose(plan.path[..., :2], feet[..., :2])
