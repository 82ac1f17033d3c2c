"""The program of clips against CasADi's own derivatives and Ipopt."""

import casadi as ca
import numpy as np
import pytest

from lacoloco.datasets.mocap import load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.retargeting import forward_kinematics as kinematics
from lacoloco.pipelines.retargeting.mocap.body_map import body_map, leg_geometry
from lacoloco.pipelines.retargeting.solve.clip_model import ClipModel
from lacoloco.pipelines.retargeting.solve.clip_problem import ClipProblem, ClipWeights, _part
from lacoloco.pipelines.retargeting.solve.interior_point import solve_stretch
from lacoloco.pipelines.retargeting.solve.leg_reach import mend
from lacoloco.pipelines.retargeting.solve.pose_problem import JOINTS, POSITION, TURN
from lacoloco.pipelines.retargeting.targets.stretch import turn_pull
from lacoloco.pipelines.retargeting.targets.targets import Targets, fitted_targets
from lacoloco.robots.registry import load_robot

SPEC = load_robot("solo12")
MAP = body_map(SPEC)
LEGS = leg_geometry(SPEC, MAP)


@pytest.fixture(scope="module")
def problem():
    return ClipProblem(SPEC, MAP, LEGS, ClipWeights())


@pytest.fixture(scope="module")
def trot():
    """Half a second of the bundled dog."""
    return fitted_targets(load_bvh(DOG_BVH).slice(330, 360), MAP, LEGS, SPEC.foot_radius())


def symbolic(stretch, smoothness):
    """Variables, cost, constraint values (V N,) and steps of a stretch, written down anew."""
    frames, n = stretch.guess.shape
    x = ca.SX.sym("x", n, frames)
    pull = turn_pull(stretch.parameters[:, :4], smoothness)
    cost, values = ca.dot(x, ca.DM(pull.T)), []
    for t in range(frames):
        reference, targets = ca.DM(stretch.parameters[t, :4]), ca.DM(stretch.parameters[t, 4:])
        quat = kinematics.multiply(reference, kinematics.small_rotation(x[TURN, t] / 4))
        base = kinematics.SymbolicPose(kinematics.rotation_of(quat), x[POSITION, t])
        model = SPEC.pinocchio_model()
        poses = kinematics.body_poses(model, base, x[JOINTS, t])
        points = [kinematics.body_position(model, poses, body) for body in SPEC.keypoints.values()]
        cost += ca.sumsqr(ca.vertcat(*points) - targets)
        cost += ClipWeights().posture * ca.sumsqr(x[JOINTS, t] - ca.DM(SPEC.retarget_neutral))
        knees = [kinematics.body_position(model, poses, body)[2] for body in SPEC.knee_frames]
        feet, hips = [points[i] for i in MAP.foot_columns], [points[i][2] for i in MAP.hip_columns]
        values += [*feet, *knees, *hips]
    for t in range(frames - 3):
        third = x[:, t + 3] - 3 * x[:, t + 2] + 3 * x[:, t + 1] - x[:, t]
        cost += ca.dot(ca.DM(smoothness), third**2)
    steps = x[JOINTS, 1:] - x[JOINTS, :-1]
    return ca.vec(x), cost, ca.vertcat(*values), ca.vec(steps)


def test_cost_rows_and_newtons_step_are_those_of_casadi(problem, trot):
    stretch = problem._stretch(Targets(trot.points[:6], trot.contacts[:6], 1.0), 60.0)
    smoothness, rng = problem._smoothness, np.random.default_rng(0)
    model = ClipModel(problem._functions, stretch, smoothness)
    point = model.at(stretch.guess + rng.normal(0, 0.03, stretch.guess.shape))
    x, cost, values, steps = symbolic(stretch, smoothness)
    rows = ca.vertcat(ca.vec(ca.reshape(x, 18, 6)[JOINTS, :]), values, steps)
    stiffness, force = rng.uniform(0, 2, point.rows.size), rng.normal(size=point.rows.size)
    outward, multipliers = 0.02 * rng.normal(size=point.rows.size), np.zeros_like(point.gap)
    step, multipliers_found = model.step(point, stiffness, force, outward, multipliers)

    jacobian, gap = ca.jacobian(rows, x), ca.reshape(values, *point.gap.T.shape)
    equal = stretch.value_bounds[0] == stretch.value_bounds[1]
    equations = ca.jacobian(ca.vec(gap), x)[np.flatnonzero(equal.ravel()).tolist(), :]
    hessian = ca.hessian(cost + ca.dot(ca.DM(outward), rows), x)[0]
    hessian += jacobian.T @ ca.diag(ca.DM(stiffness)) @ jacobian
    right = jacobian.T @ ca.DM(force) - ca.gradient(cost, x)
    parts = ca.Function("parts", [x], [cost, rows, hessian, right, equations])(point.x.ravel())
    cost, rows, hessian, right, equations = (np.array(part) for part in parts)
    assert point.cost == pytest.approx(cost.item())
    np.testing.assert_allclose(point.rows, rows.ravel(), atol=1e-12)
    # A positive definite case: the step must have been made with all of the curvature.
    assert np.linalg.eigvalsh(_within(hessian, equations)).min() > 0
    found = np.array([multipliers_found.ravel()[equal.ravel()]]).T
    balance = hessian @ step.reshape(-1, 1) + equations.T @ found - right
    np.testing.assert_allclose(balance, 0.0, atol=1e-6)
    np.testing.assert_allclose((equations @ step.ravel()), -point.gap[equal], atol=1e-9)
    moved = model.at(point.x + 1e-6 * step).rows - point.rows
    np.testing.assert_allclose(model.change(point, step), 1e6 * moved, atol=1e-4)


def _within(hessian, equations):
    """The Hessian where the equations hold."""
    _, values, axes = np.linalg.svd(equations)
    basis = axes[len(values) :].T
    return basis.T @ hessian @ basis


def test_the_minimum_is_ipopts(problem, trot):
    stretch, smoothness = problem._stretch(trot, 60.0), problem._smoothness
    found = solve_stretch(problem._functions, stretch, smoothness)
    x, cost, values, steps = symbolic(stretch, smoothness)
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes"}
    program = {"x": x, "f": cost, "g": ca.vertcat(values, steps)}
    limits = np.tile(stretch.step_limit, len(found) - 1)
    lower, upper = (bound.ravel() for bound in stretch.value_bounds)
    lower_x, upper_x = (bound.ravel() for bound in stretch.variable_bounds)
    ipopt = ca.nlpsol("ipopt", "ipopt", program, options)(
        x0=stretch.guess.ravel(),
        lbx=lower_x,
        ubx=upper_x,
        lbg=np.concatenate([lower, -limits]),
        ubg=np.concatenate([upper, limits]),
    )
    ours = float(ca.Function("cost", [x], [cost])(found.ravel()))
    assert ours == pytest.approx(float(ipopt["f"]), rel=0.02)
    assert np.abs(found.ravel() - np.array(ipopt["x"]).ravel()).max() < 0.05


def test_held_frames_stay_where_they_are(problem, trot):
    clip = problem._stretch(trot, 60.0)
    kept = solve_stretch(problem._functions, clip, problem._smoothness)[5:8]
    part = _part(clip, 5, 30, kept)
    found = solve_stretch(problem._functions, part, problem._smoothness)
    np.testing.assert_array_equal(found[:3], kept)
    limits = np.array(SPEC.velocity_limits) / 60.0
    assert (np.abs(np.diff(found[:, JOINTS], axis=0)) < limits).all()


def test_constraints_that_contradict_each_other_have_no_solution(problem, trot):
    points = trot.points.copy()
    points[15:, MAP.foot_columns[0], 0] += 3.0  # two legs would have to be metres long
    points[15:, MAP.foot_columns[1], 0] -= 3.0
    stands = np.ones_like(trot.contacts)
    stretch = problem._stretch(Targets(points, stands, trot.scale), 60.0)
    with np.errstate(all="raise"):
        assert solve_stretch(problem._functions, stretch, problem._smoothness) is None


def test_mending_leaves_no_frame_worse(problem, trot):
    clip = problem._stretch(trot, 60.0)
    found = solve_stretch(problem._functions, clip, problem._smoothness)
    near = found + np.random.default_rng(0).normal(0, 1e-3, found.shape)
    far = found + np.random.default_rng(0).normal(0, 0.3, found.shape)
    functions = problem._functions

    def gaps(variables):
        (points,) = functions.coordinates(variables, clip.parameters)
        feet = points[:, functions.value_rows[functions.feet]]
        lower, upper = (bound[:, functions.feet] for bound in clip.value_bounds)
        return np.abs(np.clip(feet, lower, upper) - feet).max(axis=1)

    mended = gaps(mend(functions, near, clip))
    assert np.percentile(mended, 90) < 1e-6  # the rest are legs that are nearly straight
    assert (mended <= gaps(near)).all()
    assert (gaps(mend(functions, far, clip)) <= gaps(far)).all()
