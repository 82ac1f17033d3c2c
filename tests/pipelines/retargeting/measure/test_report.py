import numpy as np
import pytest

from lacoloco.datasets.clip import Clip
from lacoloco.pipelines.retargeting.measure.assessment import Assessment
from lacoloco.pipelines.retargeting.measure.report import write_report
from lacoloco.pipelines.retargeting.targets.targets import Targets
from lacoloco.robots.registry import load_robot

SPEC = load_robot("solo12")


@pytest.fixture
def standing():
    """Factory of a robot that stands, every keypoint a centimetre off; the animal 2 cm higher."""

    def make(frames=20, contacts=True):
        q = np.tile(SPEC.default_qpos(), (frames, 1))
        clip = Clip.from_poses("dog", 60.0, SPEC.joint_names, q[:, :3], q[:, 3:7], q[:, 7:])
        points = np.zeros((frames, 8, 3)) + [0.0, 0.0, 0.2]
        stands = np.full((frames, 4), contacts)
        feet = np.zeros((frames, 4, 3)) + [0.0, 0.0, SPEC.foot_radius()]
        targets = Targets(points + [0.01, 0.0, 0.0], stands, 0.7)
        return Assessment(SPEC, clip, targets, points, feet, (4, 5, 6, 7), np.full(frames, 0.1))

    return make


def test_figures_are_complete_and_right(standing):
    metrics = standing().metrics()
    assert metrics["scale"] == 0.7
    assert metrics["keypoint_error_p95_m"] == pytest.approx(0.01)
    assert metrics["base_height_mean_m"] == metrics["animal_height_mean_m"] == pytest.approx(0.3)
    assert metrics["base_speed_mean_m_s"] == 0.0
    assert 0 < metrics["torque_share_p95"] <= metrics["torque_share_peak"] < 0.3
    assert metrics["torque_limit_hits"] == 0
    assert metrics["missing_force_p95"] < 0.01
    assert metrics["contact_agreement"] == 1.0


@pytest.mark.parametrize(("frames", "contacts"), [(20, True), (20, False), (2, True)])
def test_the_picture_is_a_png(standing, tmp_path, frames, contacts):
    assessment = standing(frames, contacts)
    metrics = {"name": "dog", "frames": frames, **assessment.metrics(), "solver_failures": 0}
    path = tmp_path / "report.png"
    write_report(path, assessment, metrics)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert path.stat().st_size > 20_000
