"""What a low level meets in training."""

from dataclasses import replace

from lacoloco.pipelines.evaluation.hardware_shift import HARDWARE, IN_TRAINING
from lacoloco.pipelines.low_level.config import TrainLowConfig
from lacoloco.pipelines.low_level.training_task import training_task
from lacoloco.pipelines.sim.disturbances.config import UNDISTURBED


def test_a_shift_adds_disturbances_and_changes_nothing_else(solo12):
    usual = training_task(solo12, TrainLowConfig())
    shifted = training_task(solo12, TrainLowConfig(shift="hardware"))
    assert usual.disturbances == UNDISTURBED
    assert shifted.disturbances.graded and shifted.disturbances.floor_tilt > 0.0
    assert shifted.randomisation.friction == (0.3, 2.0)
    same = replace(
        shifted,
        disturbances=UNDISTURBED,
        randomisation=replace(shifted.randomisation, friction=usual.randomisation.friction),
    )
    assert same == usual


def test_training_meets_each_disturbance_as_strong_as_the_strongest_row_of_the_evaluation():
    strongest = {}
    for row in HARDWARE.values():
        for name, value in row.disturbances.items():
            strongest[name] = max(strongest.get(name, value), value)
    trained = {name: value for name, value in IN_TRAINING.disturbances.items() if name != "graded"}
    assert trained == {name: strongest[name] for name in trained}
