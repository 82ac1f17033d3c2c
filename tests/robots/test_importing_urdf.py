"""A small quadruped of our own as a URDF, with links that only a fixed joint holds."""

from pathlib import Path

import pytest

from lacoloco.robots.check import check_robot
from lacoloco.robots.importing.importer import import_robot
from lacoloco.robots.registry import load_robot

LEGS = {"FL": (1, 1), "FR": (1, -1), "RL": (-1, 1), "RR": (-1, -1)}
TRIANGLES = ["v 0 0 0", "v 0.1 0 0", "v 0 0.1 0", "v 0 0 0.1"]
OBJ = "\n".join([*TRIANGLES, "f 1 3 2", "f 1 2 4", "f 2 3 4", "f 3 1 4"])


def link(name, mass, shape="", drawn=""):
    inertia = 'ixx="0.002" iyy="0.002" izz="0.001" ixy="0" ixz="0" iyz="0"'
    inertial = f'<inertial><origin xyz="0 0 -0.05"/><mass value="{mass}"/><inertia {inertia}/>'
    touching = f"<collision>{shape}</collision>" if shape else ""
    seen = f'<visual><geometry><mesh filename="{drawn}"/></geometry></visual>' if drawn else ""
    return f'<link name="{name}">{inertial}</inertial>{touching}{seen}</link>'


def joint(name, parent, child, xyz, axis="", limits="0 0"):
    lower, upper = limits.split()
    speed = 21 if "hip" in name else 15
    turns = f'<axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}"'
    turns += f' effort="25" velocity="{speed}"/>'
    kind = "revolute" if axis else "fixed"
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{turns if axis else ""}</joint>'


def urdf(looks="package://rover/meshes/wedge.obj"):
    box = '<geometry><box size="0.4 0.1 0.1"/></geometry>'
    rod = '<origin xyz="0 0 -0.1"/><geometry><cylinder radius="0.012" length="0.12"/></geometry>'
    parts = [link("base", 6.0, box, looks)]
    for leg, (x, y) in LEGS.items():
        parts += [
            link(f"{leg}_hip", 0.4),
            link(f"{leg}_thigh", 0.6, rod),
            link(f"{leg}_calf", 0.2, rod),
            link(f"{leg}_foot", 0.03, '<geometry><sphere radius="0.02"/></geometry>'),
            joint(
                f"{leg}_hip_joint", "base", f"{leg}_hip", f"{0.2 * x} {0.05 * y} 0", "1 0 0", "-1 1"
            ),
            joint(
                f"{leg}_thigh_joint",
                f"{leg}_hip",
                f"{leg}_thigh",
                f"0 {0.08 * y} 0",
                "0 1 0",
                "-1 3",
            ),
            joint(
                f"{leg}_calf_joint", f"{leg}_thigh", f"{leg}_calf", "0 0 -0.2", "0 1 0", "-2.7 -0.4"
            ),
            joint(f"{leg}_foot_fixed", f"{leg}_calf", f"{leg}_foot", "0 0 -0.2"),
        ]
    return f'<robot name="rover">{"".join(parts)}</robot>'


@pytest.fixture
def made(tmp_path):
    """Import a text that lies in the folder of its package; gives what came and the robot."""

    def make(text):
        package = tmp_path / "rover"
        (package / "urdf").mkdir(parents=True)
        (package / "meshes").mkdir()
        (package / "meshes" / "wedge.obj").write_text(OBJ)
        (package / "urdf" / "rover.urdf").write_text(text)
        imported = import_robot(package / "urdf" / "rover.urdf", "rover", tmp_path / "robots")
        return imported, load_robot(imported.folder)

    return make


def test_a_urdf_passes_the_check(made):
    imported, robot = made(urdf())
    assert check_robot(robot, poses=3).failures() == ()
    assert robot.feet == tuple(f"{leg}_foot" for leg in LEGS)
    assert robot.total_mass() == pytest.approx(6.0 + 4 * 1.23)
    assert list(robot.effort_limits()) == [25.0] * 12
    assert robot.velocity_limits == (21.0, 15.0, 15.0) * 4
    assert (imported.folder / "meshes" / "wedge.obj").read_text() == OBJ
    assert {question.key for question in imported.questions} == {
        "rover.xml: joint: armature",
        "robot.toml: joints: default",
    }
    assert any(note.startswith("stands for 10 s") for note in imported.notes)


def test_a_mesh_that_mujoco_does_not_read_is_converted_wherever_the_robot_goes(
    tmp_path, monkeypatch
):
    (tmp_path / "rover.urdf").write_text(urdf("wedge.ply"))
    header = ["ply", "format ascii 1.0", "element vertex 4", "element face 4", "end_header"]
    header[3:3] = [f"property float {axis}" for axis in "xyz"]
    header.insert(7, "property list uchar int vertex_indices")
    vertices = [corner.removeprefix("v ") for corner in TRIANGLES]
    faces = ["3 0 2 1", "3 0 1 3", "3 1 2 3", "3 2 0 3"]
    (tmp_path / "wedge.ply").write_text("\n".join([*header, *vertices, *faces]) + "\n")
    monkeypatch.chdir(tmp_path)
    imported = import_robot(Path("rover.urdf"), "rover", Path("robots"))
    assert not [note for note in imported.notes if "left out" in note]
    model = load_robot(imported.folder).model()
    assert (model.nmesh, model.mesh_vertnum[0]) == (1, 4)


def test_a_mesh_that_is_missing_is_named_and_left_out(made):
    imported, robot = made(urdf("package://rover/meshes/none.stl"))
    assert "left out, no such file or none that can be read: package://rover/meshes/none.stl" in (
        imported.notes
    )
    assert robot.model().nmesh == 0
