"""From a robot to a model that can be simulated: floor, motors, contact sensors, solver."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from lacoloco.robots.errors import RobotError

if TYPE_CHECKING:
    import mujoco

    from lacoloco.robots.spec import RobotSpec

TIMESTEP = 0.02 / 6
"""Physics step, s: six in a control step of 0.02 s, see ``lacoloco bench contacts``."""
CONTACT_DAMPING_RATIO = 1.0
CONTACT_IMPEDANCE = (0.95, 0.99, 0.001, 0.5, 2.0)
"""MuJoCo's ``solimp``. With its default of 0.9 to 0.95 the same spring gives a tenth less force."""
FLOOR_FRICTION = 1.0  # as the original's ground; feet override it, see _set_contacts
SOLVER_ITERATIONS = 10  # Newton needs 2, at worst 7, under random actions on either robot
LINESEARCH_ITERATIONS = 10
SOLVER_TOLERANCE = 1e-6


def compile_scene(
    robot: RobotSpec,
    *,
    floor: bool = True,
    timestep: float = TIMESTEP,
    training_limits: bool = False,
    visual: bool = False,
    change: Callable[[mujoco.MjSpec], None] | None = None,
) -> mujoco.MjModel:
    """A new model: robot + floor + position motors + contact sensors, compiled.

    Motors are in the order of ``joint_names``; ``ctrl`` is the target joint position (J,), rad,
    and the torque is clip(kp (ctrl - q) - kd qdot, +-limit), integrated implicitly
    (``implicitfast``). Speed limits are not enforced: MuJoCo has none.

    Every body of ``robot.contact_bodies`` gets a sensor ``force_<body>``: the sum of its contact
    forces, friction included, (3,), world frame, N. Only the norm should be read: which of the two
    touching bodies it acts on is a convention of the engine.

    Args:
        robot: The robot.
        floor: Add the plane ``floor`` at z = 0.
        timestep: Physics step, s.
        training_limits: Torque limits of training instead of those of the motors.
        visual: Keep the geoms that are only looked at (rendering; a little slower).
        change: Changes the scene before it is compiled.

    Raises:
        RobotError: The MJCF lacks a body or joint the spec names.
    """
    spec = robot.editable_model()
    spec.compiler.discardvisual = not visual
    _set_solver(spec, timestep)
    if floor:
        _add_floor(spec)
    _set_contacts(spec, robot, contact_time(timestep))
    _add_motors(spec, robot, training_limits)
    _add_sensors(spec, robot)
    if change is not None:
        change(spec)
    for key in spec.keys:
        key.ctrl = list(key.qpos)[7:]
    return spec.compile()


def scene_xml(robot: RobotSpec) -> str:
    """The same scene as MJCF, for programs without lacoloco.

    Raises:
        RobotError: As :func:`compile_scene`.
    """
    scenes: list[mujoco.MjSpec] = []
    compile_scene(robot, change=scenes.append)
    text: str = scenes[0].to_xml()
    return text


def contact_time(timestep: float) -> float:
    """Time constant of a contact, s: MuJoCo's first number of ``solref``, and the shortest that it
    keeps stable at that physics step.

    The stiffness of a contact is its effective mass / time constant^2, so that a stiffer contact
    needs more steps a second.
    """
    return 2.0 * timestep


def _set_solver(spec: mujoco.MjSpec, timestep: float) -> None:
    import mujoco

    option = spec.option
    option.timestep = timestep
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    option.iterations = SOLVER_ITERATIONS
    option.ls_iterations = LINESEARCH_ITERATIONS
    option.tolerance = SOLVER_TOLERANCE
    # one robot per world is one island: there are no others to look for
    option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ISLAND)


def _add_floor(spec: mujoco.MjSpec) -> None:
    import mujoco

    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 1],  # 0: infinite; 1 m: spacing of the grid lines when drawn
        friction=[FLOOR_FRICTION, 0.005, 0.0001],
        rgba=[0.78, 0.8, 0.82, 1],
    )
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        dir=[0.3, 0.4, -1],
        diffuse=[0.5, 0.5, 0.5],
        specular=[0.1, 0.1, 0.1],
        castshadow=False,
    )


def _set_contacts(spec: mujoco.MjSpec, robot: RobotSpec, time: float) -> None:
    """Stiffness of all contacts; self collision by contype/conaffinity; feet decide the friction,
    stiffness and damping of their contacts.

    Two geoms touch if (contype1 & conaffinity2) | (contype2 & conaffinity1). Friction is the larger
    of the two unless priorities differ, so only with a higher priority can a foot's friction,
    randomised per world, fall below the floor's.
    """
    feet = set(robot.feet)
    for geom in spec.geoms:
        geom.solref = [time, CONTACT_DAMPING_RATIO]
        geom.solimp = list(CONTACT_IMPEDANCE)
    for body in spec.bodies[1:]:
        for geom in body.geoms:
            touches = bool(geom.contype or geom.conaffinity)
            if touches and not robot.self_collision:
                geom.contype, geom.conaffinity = 0, 1
            if touches and body.name in feet:
                geom.priority = 1


def _add_motors(spec: mujoco.MjSpec, robot: RobotSpec, training_limits: bool) -> None:
    import mujoco

    for i, name in enumerate(robot.joint_names):
        joint = spec.joint(name)
        if joint is None:
            raise RobotError(f"{robot.mjcf}: no joint {name!r}; fix joint_names of {robot.name!r}")
        limit = robot.training_effort_limits[i] if training_limits else joint.actfrcrange[1]
        joint.actfrcrange = [-limit, limit]
        motor = spec.add_actuator(name=name, target=name, forcerange=[-limit, limit])
        motor.set_to_position(kp=robot.stiffness[i], kv=robot.damping[i])
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT


def _add_sensors(spec: mujoco.MjSpec, robot: RobotSpec) -> None:
    import mujoco

    netforce = 3  # reduce: none, mindist, maxforce, netforce
    force = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE)
    for name in robot.contact_bodies:
        if spec.body(name) is None:
            raise RobotError(f"{robot.mjcf}: no body {name!r}; fix the spec of {robot.name!r}")
        spec.add_sensor(
            name=f"force_{name}",
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            objname=name,
            intprm=[force, netforce, 1],
        )
