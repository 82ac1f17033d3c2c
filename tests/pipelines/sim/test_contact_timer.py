import torch

from lacoloco.pipelines.sim.contact_timer import FootTimer
from lacoloco.pipelines.sim.physics import CONTROL_DT


def run(timer, forces):
    seen = []
    for force in forces:
        timer.update(torch.tensor([[force]]))
        seen.append((bool(timer.touch_down), float(timer.last_air_time)))
    return seen


def test_a_touch_down_reports_the_flight_before_it():
    timer = FootTimer(1, 1, torch.device("cpu"))
    seen = run(timer, [20.0, 0.0, 0.5, 0.0, 3.0, 20.0])
    assert [down for down, _ in seen] == [False, False, False, False, True, False]
    # 0.5 N is less than a contact: three steps in the air.
    assert abs(seen[4][1] - 3 * CONTROL_DT) < 1e-7
    assert float(timer.air_time) == 0.0


def test_an_episode_begins_on_the_ground():
    timer = FootTimer(2, 3, torch.device("cpu"))
    for _ in range(4):
        timer.update(torch.zeros(2, 3))
    timer.reset(torch.tensor([1]))
    timer.update(torch.full((2, 3), 9.0))
    assert timer.touch_down.tolist() == [[True] * 3, [False] * 3]
    assert timer.last_air_time[1].tolist() == [0.0] * 3


def test_state_dict_restores_all_of_it():
    timer, other = (FootTimer(2, 2, torch.device("cpu")) for _ in range(2))
    for _ in range(3):
        timer.update(torch.tensor([[0.0, 9.0], [9.0, 0.0]]))
    other.load_state_dict({key: value.clone() for key, value in timer.state_dict().items()})
    for each in (timer, other):
        each.update(torch.full((2, 2), 9.0))
    assert torch.equal(timer.touch_down, other.touch_down)
    assert torch.equal(timer.last_air_time, other.last_air_time)
