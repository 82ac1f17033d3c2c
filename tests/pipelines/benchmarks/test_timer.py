"""Where the time goes, by a clock that the test turns."""

import pytest

from lacoloco.pipelines.benchmarks.timer import Stopwatch


class Clock:
    def __init__(self):
        self.now, self.waits = 0.0, 0

    def __call__(self):
        return self.now

    def wait(self):
        self.waits += 1


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def watch(clock):
    return Stopwatch(clock.wait, clock)


def test_a_part_inside_another_counts_once(watch, clock):
    with watch.part("outer"):
        clock.now += 1.0
        with watch.part("inner"):
            clock.now += 5.0
        clock.now += 2.0
    clock.now += 100.0
    assert watch.seconds == {"outer": 3.0, "inner": 5.0}
    assert clock.waits == 4, "a GPU is waited for before every look at the clock"


def test_parts_add_up_and_may_contain_themselves(watch, clock):
    for _ in range(2):
        with watch.part("a"), watch.part("a"):
            clock.now += 1.5
    assert watch.seconds == {"a": 3.0}


def test_calls_of_a_watched_method_are_counted_and_do_what_they_did(watch, clock):
    class Worker:
        def work(self, seconds, *, factor=1.0):
            clock.now += seconds * factor
            return "done"

    worker, other = Worker(), Worker()
    watch.watch(worker, "work", "work")
    assert worker.work(2.0, factor=3.0) == "done"
    other.work(50.0)
    assert watch.seconds == {"work": 6.0}


def test_an_error_stops_the_clock_too(watch, clock):
    with pytest.raises(RuntimeError), watch.part("a"):
        clock.now += 1.0
        raise RuntimeError
    clock.now += 9.0
    with watch.part("b"):
        clock.now += 3.0
    assert watch.seconds == {"a": 1.0, "b": 3.0}


def test_shares_sum_to_one_largest_first(watch, clock):
    for name, seconds in (("a", 1.0), ("b", 3.0)):
        with watch.part(name):
            clock.now += seconds
    assert list(watch.shares().items()) == [("b", 0.75), ("a", 0.25)]
    assert Stopwatch().shares() == {}
