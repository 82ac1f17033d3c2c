"""Which run and which inputs a verb takes, and what it says of them."""

import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lacoloco.datasets.clip import save_clips
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.stage import StageContext
from lacoloco_cli.main import app
from lacoloco_cli.session import Session


def test_the_run_used_last_is_the_one_that_something_was_begun_in():
    store = RunStore()
    context = StageContext(store, "made")
    context.store.begin("read", "play", at_once=True)
    assert store.last_run() is None  # what only reads leaves the next verb where it was
    context.begin("retarget", None)
    assert store.last_run() == "made"
    failed = CliRunner().invoke(app, ["train-low", "--run", "typo", "--preset", "smoke"])
    assert failed.exit_code == 2
    assert store.last_run() == "made"


def test_a_verb_asks_which_motions_where_a_run_has_several_kinds(make_clip):
    store = RunStore()
    for stage in ("generate", "retarget"):
        directory = store.begin("mixed", stage)
        save_clips(
            directory.file("artifact.h5"), [make_clip(joints=12)], robot=("x", "0"), config={}
        )
        directory.complete()
    result = CliRunner().invoke(app, ["train-low", "--run", "mixed", "--preset", "smoke"])
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    for stage in ("generate", "retarget"):
        assert f"--motions {store.newest('mixed', stage)}" in result.stderr


def test_imported_motions_that_track_has_not_followed_are_asked_about_too(make_clip):
    store = RunStore()
    for stage, parents in (("retarget", ()), ("track", ("retarget",)), ("import", ())):
        directory = store.begin("mixed", stage)
        save_clips(
            directory.file("artifact.h5"),
            [make_clip(joints=12)],
            robot=("x", "0"),
            config={},
            parents=[store.newest("mixed", parent) for parent in parents],
        )
        directory.complete()
    result = CliRunner().invoke(app, ["train-low", "--run", "mixed", "--preset", "smoke"])
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    for stage in ("track", "import"):
        assert f"--motions {store.newest('mixed', stage)}" in result.stderr


def test_a_verb_says_in_one_line_what_it_takes(capsys):
    session = Session("eval", run="dog")
    assert session.takes(Path("a.h5"), Path("/b.h5")) == [Path("a.h5"), Path("/b.h5")]
    assert capsys.readouterr().err == "eval of run 'dog' takes a.h5, /b.h5\n"


@pytest.mark.parametrize(
    ("terminal", "said"), [(True, "next: lacoloco eval --run dog\n"), (False, "")]
)
def test_a_person_is_told_what_to_do_next(capsys, monkeypatch, terminal, said):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    session = Session("train-high", run="dog")
    session.progress.stop()
    session.answer({"artifact": "x"})
    assert capsys.readouterr().err.endswith(said)


def test_where_a_verbs_name_does_not_say_what_comes_next_it_says_so_itself(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    session = Session("import", run="dog")
    session.progress.stop()
    session.answer({"artifact": "x"})
    assert "next:" not in capsys.readouterr().err
    session.answer({"artifact": "x"}, then="track")
    assert capsys.readouterr().err.endswith("next: lacoloco track --run dog\n")
