"""The check that `lacoloco bench gpu` begins with: it passes where the engines agree and fails
where they do not.
"""

import pytest
import torch

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.sim import parity
from lacoloco.pipelines.sim.mujoco_cpu import BatchPhysics
from lacoloco.robots.scene import compile_scene


@pytest.fixture
def instead_of_warp(monkeypatch):
    """The C engine twice; ``spoil`` changes what the first of the two gives."""
    warp = pytest.importorskip("lacoloco.pipelines.sim.mujoco_warp", reason="needs MuJoCo Warp")

    def install(spoil=lambda engine: None):
        class Spoilt(BatchPhysics):
            def __init__(self, request, device):
                super().__init__(request)

            def step(self, targets):
                super().step(targets)
                spoil(self)

        monkeypatch.setattr(warp, "WarpPhysics", Spoilt)

    return install


def test_equal_engines_pass(instead_of_warp, robot):
    instead_of_warp()
    found = parity.check_parity(robot, "cpu", 16)
    assert 0.1 < found["touching"] < 1.0
    assert {name: found[name] for name in parity.TOLERANCES} == dict.fromkeys(
        parity.TOLERANCES, 0.0
    )


def shifted(name, amount):
    def spoil(engine):
        setattr(engine, name, getattr(engine, name) + amount)

    return spoil


@pytest.mark.parametrize(
    ("name", "amount"),
    [
        ("qpos", 1e-4),
        ("qvel", 0.01),
        ("torque", 0.05),
        ("foot_force", 0.5),
        ("body_force", torch.nan),
    ],
)
def test_a_difference_is_refused_by_name(instead_of_warp, solo12, name, amount):
    instead_of_warp(shifted(name, amount))
    with pytest.raises(StageError, match=f"solo12 on cpu: .* differ in {name}"):
        parity.check_parity(solo12, "cpu", 8)


def test_robots_near_the_ground_touch_it_by_at_most_a_centimetre(robot):
    generator = torch.Generator().manual_seed(1)
    qpos, qvel = parity.near_the_ground(robot, 12, generator)
    model = compile_scene(robot)
    lowest = torch.tensor(list(parity._lowest_feet(robot, model, qpos)))
    assert float(lowest.abs().max()) < 0.0101
    assert float(lowest.min()) < 0.0 < float(lowest.max())
    assert qvel.shape == (12, 6 + robot.num_joints)
