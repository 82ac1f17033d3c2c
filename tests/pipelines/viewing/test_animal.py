import shutil

import numpy as np
import pytest

from lacoloco.datasets.artifact import read_artifact
from lacoloco.datasets.clip import clips_of
from lacoloco.datasets.mocap import load_bvh
from lacoloco.datasets.samples import DOG_BVH
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines import retarget
from lacoloco.pipelines.retargeting.forward_kinematics import BodyPositions
from lacoloco.pipelines.stage import StageContext
from lacoloco.pipelines.viewing.animal import with_animal
from lacoloco.pipelines.viewing.recording import from_clip
from lacoloco.robots.registry import load_robot

SPEC = load_robot("solo12")


@pytest.fixture(scope="module")
def retargeted(tmp_path_factory):
    """Motions of a copy of the bundled dog, and that copy."""
    folder = tmp_path_factory.mktemp("dog")
    copy = folder / "dog.bvh"
    shutil.copy(DOG_BVH, copy)
    context = StageContext(RunStore(folder / "runs"), "dog")
    result = retarget.run(retarget.RetargetConfig(), context, robot="solo12", sources=[copy])
    return read_artifact(result.artifact), copy


def test_the_animal_walks_with_the_robot(retargeted):
    artifact, _ = retargeted
    clip = from_clip(clips_of(artifact)[0])
    shown = with_animal(clip, artifact, 0, SPEC)
    mocap = load_bvh(DOG_BVH)
    assert shown.skeleton.shape == mocap.positions.shape
    assert len(shown.bones) == len(mocap.joint_names) - 1
    hips = shown.skeleton[:, [mocap.joint_names.index(f"{s}UpLeg") for s in ("Left", "Right")]]
    robot = BodyPositions(SPEC.pinocchio_model(), ["HL_SHOULDER", "HR_SHOULDER"])
    hind = robot(shown.root_pos, shown.root_quat, shown.joint_pos)
    assert np.linalg.norm(hips.mean(1) - hind.mean(1), axis=1).max() < 0.15
    paw = shown.skeleton[:, mocap.joint_names.index("LeftHand_end"), 2]
    assert np.median(paw[clip.contacts[:, 0]]) == pytest.approx(SPEC.foot_radius(), abs=0.005)


def test_without_its_animal_a_clip_is_shown_alone(retargeted):
    artifact, copy = retargeted
    clip = from_clip(clips_of(artifact)[0])
    text = copy.read_text()
    copy.write_text(text + "\n")
    assert with_animal(clip, artifact, 0, SPEC).skeleton is None  # changed since
    copy.unlink()
    assert with_animal(clip, artifact, 0, SPEC).skeleton is None  # gone
    copy.write_text(text)
    assert with_animal(clip.until(1.0), artifact, 0, SPEC).skeleton is None  # not the whole clip
