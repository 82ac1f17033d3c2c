"""The program of clips against CasADi's own derivatives and Ipopt."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from lacoloco.datasets.mocap import load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.pipelines.retargeting import forward_kinematics as kinematics
from lacoloco.pipelines.retargeting.mocap.body_map import body_map, leg_geometry
from lacoloco.pipelines.retargeting.solve import stretch_solver
from lacoloco.pipelines.retargeting.solve.clip_problem import ClipProblem, ClipWeights, _part
from lacoloco.pipelines.retargeting.solve.leg_reach import mend
from lacoloco.pipelines.retargeting.solve.pose_problem import JOINTS, POSITION, TURN
from lacoloco.pipelines.retargeting.solve.stretch_program import stretch_program
from lacoloco.pipelines.retargeting.solve.stretch_solver import OPTIONS, solve_stretch
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
        feet, hips = (
            [points[i] for i in MAP.foot_keypoints],
            [points[i][2] for i in MAP.hip_keypoints],
        )
        values += [*feet, *knees, *hips]
    for t in range(frames - 3):
        third = x[:, t + 3] - 3 * x[:, t + 2] + 3 * x[:, t + 1] - x[:, t]
        cost += ca.dot(ca.DM(smoothness), third**2)
    steps = x[JOINTS, 1:] - x[JOINTS, :-1]
    return ca.vec(x), cost, ca.vertcat(*values), ca.vec(steps)


@pytest.mark.parametrize("frames", [1, 2, 4, 6])
def test_cost_rows_and_derivatives_are_those_of_casadi(problem, trot, frames):
    points, contacts = trot.points[10 : 10 + frames], trot.contacts[10 : 10 + frames]
    stretch = problem._stretch(Targets(points, contacts, 1.0), 60.0)
    smoothness, rng = problem._smoothness, np.random.default_rng(0)
    x, cost, values, steps = symbolic(stretch, smoothness)
    rows = ca.vertcat(values, steps)
    used = np.flatnonzero(rng.random(rows.numel()) < 0.7).tolist()
    solver = stretch_program(problem._functions.derivatives, frames, smoothness, used, OPTIONS)
    at = (stretch.guess + rng.normal(0, 0.03, stretch.guess.shape)).ravel()
    pull = turn_pull(stretch.parameters[:, :4], smoothness)
    parameters = np.concatenate([stretch.parameters.ravel(), pull.ravel()])
    multipliers, weight = rng.normal(size=len(used)), 0.7
    lagrangian = weight * cost + ca.dot(ca.DM(multipliers), rows[used])
    parts = [cost, ca.gradient(cost, x), rows[used], ca.jacobian(rows[used], x)]
    parts.append(ca.triu(ca.hessian(lagrangian, x)[0]))
    expected = [np.array(ca.densify(part)) for part in ca.Function("all", [x], parts)(at)]
    found = [*solver.get_function("nlp_grad_f")(at, parameters)]
    found += [*solver.get_function("nlp_jac_g")(at, parameters)]
    found.append(solver.get_function("nlp_hess_l")(at, parameters, weight, multipliers))
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(np.array(ca.densify(ours)), theirs, atol=1e-9)


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
    points[15:, MAP.foot_keypoints[0], 0] += 3.0  # two legs would have to be metres long
    points[15:, MAP.foot_keypoints[1], 0] -= 3.0
    stands = np.ones_like(trot.contacts)
    stretch = problem._stretch(Targets(points, stands, trot.scale), 60.0)
    with np.errstate(all="raise"):
        assert solve_stretch(problem._functions, stretch, problem._smoothness) is None


def test_constraints_that_were_left_out_are_taken_in(problem, trot, monkeypatch):
    clip = problem._stretch(trot, 60.0)
    free = solve_stretch(problem._functions, clip, problem._smoothness)
    steps = np.abs(np.diff(free[:, JOINTS], axis=0))
    clip = replace(clip, step_limit=0.95 * steps[5:-5].max(axis=0))
    guess = np.tile(free.mean(axis=0), (len(free), 1))  # nothing is near its limit of speed
    clip = replace(clip, guess=guess)
    with monkeypatch.context() as once:
        once.setattr(stretch_solver, "ROUNDS", 1)
        assert solve_stretch(problem._functions, clip, problem._smoothness) is None
    found = solve_stretch(problem._functions, clip, problem._smoothness)
    assert (np.abs(np.diff(found[:, JOINTS], axis=0)) < 1.02 * clip.step_limit).all()


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
