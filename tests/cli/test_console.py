from __future__ import annotations

import pytest

from lacoloco_cli import console


class Clock:
    """Seconds that pass only when told to."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


def test_rate_and_time_left(clock):
    meter = console.Meter(1000, clock)
    clock.now = 2.0
    meter.update(200)
    assert meter.rate == pytest.approx(100)
    assert meter.summary() == "200/1,000 (20%) 100/s eta 8s"


def test_rate_follows_a_change_of_pace(clock):
    meter = console.Meter(0, clock)
    done = 0
    for second in range(1, 201):
        clock.now = float(second)
        done += 10 if second <= 100 else 1000
        meter.update(done)
    assert meter.rate == pytest.approx(1000)


def test_rate_of_many_small_steps(clock):
    meter = console.Meter(0, clock)
    for step in range(1, 101):
        clock.now = step / 50
        meter.update(step)
    assert meter.rate == pytest.approx(50)


def test_work_done_before_a_resume_does_not_count_as_speed(clock):
    meter = console.Meter(3000, clock)
    clock.now = 0.01
    meter.update(2000)
    clock.now = 10.01
    meter.update(2100)
    assert meter.rate == pytest.approx(10)


def test_plain_lines_are_at_most_one_in_ten_seconds(clock, capsys):
    lines = console.Lines(clock)
    lines.start("train-low seed 0", 100)
    for second in range(1, 36):
        clock.now = float(second)
        lines.advance(second, reward=second / 10)
    lines.stop()
    printed = capsys.readouterr()
    assert printed.out == ""
    rows = printed.err.splitlines()
    assert [row.split("  ")[1].split("/")[0] for row in rows] == ["10", "20", "30", "35"]
    assert all(row.startswith("train-low seed 0  ") for row in rows)
    assert rows[-1].endswith("reward 3.5")


def test_last_line_is_not_printed_twice(clock, capsys):
    lines = console.Lines(clock)
    lines.start("clip", 10)
    clock.now = 11.0
    lines.advance(10)
    lines.stop()
    lines.stop()
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_saying_something_does_not_need_a_part(capsys):
    console.Lines().say("experts are trained, the run has none")
    assert capsys.readouterr().err == "experts are trained, the run has none\n"


def test_bar_shows_figures_and_survives_use_out_of_order(capsys):
    bar = console.Bar()
    bar.advance(3)
    bar.stop()
    bar.start("train-high", 10)
    bar.advance(10, error=0.125)
    bar.say("[not markup] half way")
    bar.stop()
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "[not markup] half way" in printed.err
    assert "train-high" in printed.err
    assert "error 0.125" in printed.err


def test_quiet_shows_nothing(capsys):
    shown = console.progress(quiet=True)
    shown.start("x", 1)
    shown.advance(1, y=1.0)
    shown.say("z")
    shown.stop()
    printed = capsys.readouterr()
    assert printed.out + printed.err == ""


def test_table_goes_to_stdout_and_is_not_cut(capsys):
    long = "runs/quickstart/train-low/0001/" + "x" * 80
    console.print_table(["stage", "s", "where"], [["train-low", 1.5, long], ["eval", None, "[b]"]])
    printed = capsys.readouterr()
    assert printed.err == ""
    assert long in printed.out
    assert "[b]" in printed.out


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0s"), (59.6, "1m00s"), (185, "3m05s"), (7620, "2h07m")]
)
def test_duration(seconds, text):
    assert console.duration_text(seconds) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "-"),
        (True, "True"),
        (0.123456, "0.1235"),
        (123456.7, "123,457"),
        (12345, "12,345"),
        (2.665e-13, "0"),
        (-5e-5, "-5e-05"),
    ],
)
def test_cell(value, text):
    assert console.cell_text(value) == text


def in_a_terminal(monkeypatch, columns):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", str(columns))


def test_a_table_that_is_too_wide_for_the_terminal_becomes_lines(monkeypatch, capsys):
    columns = [f"a long heading {i}" for i in range(16)]
    in_a_terminal(monkeypatch, 80)
    console.print_table(columns, [[float(i) for i in range(16)]] * 2)
    lines = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert lines[3] == "a long heading 3   3"
    assert len(lines) == 2 * 17
    in_a_terminal(monkeypatch, 400)
    console.print_table(columns, [[float(i) for i in range(16)]] * 2)
    assert len(capsys.readouterr().out.splitlines()) == 3
