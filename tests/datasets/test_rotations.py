"""Properties that hold for every rotation, on both libraries and both precisions."""

import math

import numpy as np
import pytest
import torch

from lacoloco.datasets import rotations

COUNT = 500


@pytest.fixture(params=["numpy64", "numpy32", "torch64", "torch32"])
def kind(request):
    return request.param


def sample(kind, *shape, seed=0):
    values = np.random.default_rng(seed).standard_normal(shape)
    values = values.astype(np.float32 if kind.endswith("32") else np.float64)
    return torch.from_numpy(values) if kind.startswith("torch") else values


def unit(kind, seed=0, count=COUNT):
    return rotations.normalize(sample(kind, count, 4, seed=seed))


def close(kind, actual, expected, scale=1.0):
    assert type(actual) is type(expected)
    assert actual.dtype == expected.dtype
    tolerance = scale * (5e-6 if kind.endswith("32") else 1e-12)
    np.testing.assert_allclose(np.asarray(actual), np.asarray(expected), rtol=0, atol=tolerance)


def close_rotation(kind, actual, expected, scale=1.0):
    close(kind, rotations.same_hemisphere(actual, expected), expected, scale)


def test_product_is_associative_and_matches_matrices(kind):
    p, q, r = (unit(kind, seed) for seed in range(3))
    multiply = rotations.multiply
    close(kind, multiply(multiply(p, q), r), multiply(p, multiply(q, r)))
    close(
        kind,
        rotations.to_matrix(multiply(p, q)),
        rotations.to_matrix(p) @ rotations.to_matrix(q),
    )


def test_conjugate_undoes_the_rotation(kind):
    q, v = unit(kind), sample(kind, COUNT, 3, seed=9)
    identity = rotations.multiply(q, rotations.conjugate(q))
    close(kind, identity[:, 0], 0 * q[:, 0] + 1)
    close(kind, identity[:, 1:], 0 * v)
    close(kind, rotations.rotate_inverse(q, rotations.rotate(q, v)), v, scale=5)


def test_rotate_equals_the_matrix_and_broadcasts(kind):
    q, v = unit(kind), sample(kind, 3, seed=4)
    close(kind, rotations.rotate(q, v), rotations.to_matrix(q) @ v, scale=5)
    close(kind, rotations.rotate(-q, v), rotations.rotate(q, v))


def test_quarter_turn_about_z_takes_x_to_y():
    q = np.array([math.cos(math.pi / 4), 0.0, 0.0, math.sin(math.pi / 4)])
    np.testing.assert_allclose(rotations.rotate(q, np.array([1.0, 0, 0])), [0, 1, 0], atol=1e-15)
    assert rotations.yaw(q) == pytest.approx(math.pi / 2)


def test_exp_and_log_are_inverse(kind):
    q = unit(kind)
    close_rotation(kind, rotations.exp_map(rotations.log_map(q)), q)
    short = sample(kind, COUNT, 3, seed=3) * 0.5
    close(kind, rotations.log_map(rotations.exp_map(short)), short)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-6, 1.1e-6, 1e-3, 1.0, math.pi - 1e-6])
def test_exp_and_log_of_small_and_large_angles(angle):
    vector = np.array([0.0, 0.6, 0.8]) * angle
    q = rotations.exp_map(vector)
    np.testing.assert_allclose(q[0], math.cos(angle / 2), rtol=0, atol=1e-15)
    np.testing.assert_allclose(rotations.log_map(q), vector, rtol=1e-9, atol=1e-16)
    np.testing.assert_allclose(rotations.log_map(-q), vector, rtol=1e-9, atol=1e-16)


def test_matrix_round_trip_also_at_half_turns(kind):
    q = unit(kind)
    close_rotation(kind, rotations.from_matrix(rotations.to_matrix(q)), q)
    half_turns = q * 0
    half_turns[0, 1] = half_turns[1, 2] = half_turns[2, 3] = half_turns[3, 0] = 1
    half_turns = half_turns[:4]
    close_rotation(kind, rotations.from_matrix(rotations.to_matrix(half_turns)), half_turns)


def test_euler_is_the_product_of_its_turns(kind):
    angles = sample(kind, COUNT, 3)
    axes = np.eye(3)[[2, 0, 1]]
    expected = None
    for index, axis in enumerate(axes):
        vector = np.asarray(angles)[:, index : index + 1].astype(np.float64) * axis
        turn = rotations.to_matrix(rotations.exp_map(vector))
        expected = turn if expected is None else expected @ turn
    actual = rotations.to_matrix(rotations.from_euler(angles, "ZXY"))
    np.testing.assert_allclose(
        np.asarray(actual), expected, atol=5e-6 if kind.endswith("32") else 1e-12
    )


def test_slerp_ends_speed_and_sign(kind):
    a, b = unit(kind, 1), unit(kind, 2)
    zero = a[:, 0] * 0
    close(kind, rotations.slerp(a, b, zero), a)
    close_rotation(kind, rotations.slerp(a, b, zero + 1), b)
    close(kind, rotations.slerp(a, -b, zero + 0.3), rotations.slerp(a, b, zero + 0.3))
    total = rotations.log_map(rotations.multiply(rotations.conjugate(a), b))
    part = rotations.slerp(a, b, zero + 0.3)
    part = rotations.log_map(rotations.multiply(rotations.conjugate(a), part))
    close(kind, part, 0.3 * total, scale=10)


def test_slerp_takes_the_shorter_arc():
    a, b = np.array([1.0, 0, 0, 0]), rotations.from_yaw(np.float64(math.radians(350)))
    middle = rotations.slerp(a, b, np.float64(0.5))
    assert math.degrees(float(rotations.yaw(middle))) == pytest.approx(-5.0)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 9.9e-5, 1.01e-4, math.pi])
def test_slerp_stays_finite_and_of_unit_length(angle):
    a = np.array([1.0, 0, 0, 0])
    b = rotations.exp_map(np.array([angle, 0, 0]))
    for fraction in np.linspace(0, 1, 5):
        q = rotations.slerp(a, b, np.float64(fraction))
        expected = rotations.exp_map(np.array([angle * fraction, 0, 0]))
        np.testing.assert_allclose(q, expected, rtol=0, atol=1e-13)


def test_angular_velocity_integrates_back(kind):
    start, omega = unit(kind), sample(kind, COUNT, 3, seed=5)
    dt = 0.02
    end = rotations.multiply(start, rotations.exp_map(omega * dt))
    for sign in (1, -1):  # the sign of the second quaternion carries no meaning
        close(kind, rotations.angular_velocity_b(start, sign * end, dt), omega, scale=200)


def test_continuous_removes_flips_and_nothing_else(kind):
    vectors = np.linspace([0, 0, 0], [0, 0, 12.0], 200)
    smooth = rotations.exp_map(vectors.astype(np.float32 if kind.endswith("32") else np.float64))
    flips = np.where(np.random.default_rng(1).random(200) < 0.5, -1, 1).astype(smooth.dtype)
    flips[0] = 1
    flipped = smooth * flips[:, None]
    if kind.startswith("torch"):
        smooth, flipped = torch.from_numpy(smooth), torch.from_numpy(flipped)
    close(kind, rotations.continuous(flipped), smooth)


def test_yaw_round_trip_and_independence_of_tilt(kind):
    heading = sample(kind, COUNT)
    heading = heading.clip(-3.0, 3.0)
    close(kind, rotations.yaw(rotations.from_yaw(heading)), heading)
    pitch = np.array([0.0, 0.4, 0.0])
    q = rotations.multiply(rotations.from_yaw(np.float64(1.2)), rotations.exp_map(pitch))
    assert float(rotations.yaw(q)) == pytest.approx(1.2)


def test_gradients_flow_through_small_angles():
    vector = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    rotations.log_map(rotations.exp_map(vector)).sum().backward()
    assert torch.allclose(vector.grad, torch.ones(3, dtype=torch.float64))
