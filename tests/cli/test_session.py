from __future__ import annotations

import errno
import json
import math
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from lacoloco.datasets.errors import DatasetError
from lacoloco.datasets.robot_record import RobotRecord
from lacoloco.datasets.store import RunStore  # noqa: F401  loaded before folders turn read-only
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.stage import StageContext  # noqa: F401
from lacoloco.robots.errors import RobotError
from lacoloco_cli.failures import UserError
from lacoloco_cli.options import AT_ONCE, READING
from lacoloco_cli.session import Session, verb


@dataclass(frozen=True)
class Config:
    samples: int = 100


PRESETS = {"smoke": lambda: Config(samples=1), "laptop": Config}


def command_of(body, **settings):
    app = typer.Typer()
    verb(app, **settings)(body)
    return app


def invoke(body, *arguments, **settings):
    return CliRunner().invoke(command_of(body, **settings), list(arguments))


def begin(session, verb="train-low", config=None, **changes):
    """Begin a version as a stage does, and leave it unfinished."""
    context = replace(session.context(), **changes)
    return context.begin(verb, context.work(config or Config(), RobotRecord("", "")))


def invoke_as(name, body, *arguments):
    """Invoke a body under the name of a verb, the way `lacoloco NAME ...` does."""
    app = command_of(body)
    obj = {"arguments": [name, *arguments]}
    return CliRunner().invoke(app, list(arguments), obj=obj, prog_name=name)


def test_own_and_shared_options_reach_the_body():
    seen = {}

    def body(
        session: Session,
        paths: Annotated[list[Path] | None, typer.Argument()] = None,
        disc: Annotated[str, typer.Option("--disc")] = "drail",
    ) -> None:
        seen.update(session=session, paths=paths, disc=disc)

    arguments = "a.bvh b.bvh --disc gan --run r --preset smoke --set samples=2 --set samples=3"
    result = invoke(body, *arguments.split(), "--seed", "4", "--resume", "--quiet")
    assert result.exit_code == 0, result.output
    session = seen["session"]
    assert (seen["paths"], seen["disc"]) == ([Path("a.bvh"), Path("b.bvh")], "gan")
    assert (session.run, session.preset, session.seed) == ("r", "smoke", 4)
    assert list(session.overrides) == ["samples=2", "samples=3"]
    assert session.resume and session.quiet and not session.debug
    assert session.config(PRESETS) == Config(samples=3)


def test_answer_is_one_line_per_key_without_json():
    result = invoke(lambda session: session.answer({"artifact": "a.h5", "samples": 3}))
    assert result.stdout == "artifact: a.h5\nsamples: 3\n"


def test_json_is_the_only_thing_on_stdout():
    def body(session: Session) -> None:
        sys.stdout.write("a library talks\n")
        session.progress.say("training experts")
        session.answer({"artifact": Path("a.h5"), "loss": np.float32(0.5), "bad": math.nan})

    result = invoke(body, "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout) == {"artifact": "a.h5", "loss": 0.5, "bad": None}
    assert "a library talks" in result.stderr
    assert "training experts" in result.stderr


def test_json_keeps_out_what_c_code_prints():
    code = (
        "import os\n"
        "from lacoloco_cli.session import Session, guarded\n"
        "session = Session(verb='retarget', as_json=True)\n"
        "with guarded(session):\n"
        "    os.write(1, b'Ipopt says hello\\n')\n"
        "    session.answer({'frames': 3})\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(ran.stdout) == {"frames": 3}
    assert ran.stderr == "Ipopt says hello\n"


@pytest.mark.parametrize("kind", [DatasetError, RobotError, StageError, UserError])
def test_mistake_of_the_user_is_one_line_and_exit_code_2(kind):
    def body(session: Session) -> None:
        raise kind("dog.bvh:\n  has no frames;\n  record again")

    result = invoke(body)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr == "error: dog.bvh: has no frames; record again\n"


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(errno.ENAMETOOLONG, "File name too long", "x.bvh"), "x.bvh: file name too long"),
        (PermissionError(errno.EACCES, "Permission denied", "a"), "a: permission denied; check"),
        (OSError(errno.ENOSPC, "No space left on device"), "no space left on device; make room"),
    ],
)
def test_what_the_system_refuses_is_no_bug(error, said):
    def body(session: Session) -> None:
        raise error

    result = invoke(body)
    assert result.exit_code == 2
    assert result.stderr.startswith(f"error: {said}")
    assert result.stderr.count("\n") == 1


def test_a_missing_file_of_ours_is_a_bug():
    def body(session: Session) -> None:
        open("gone").close()

    assert invoke(body).exit_code == 1


def test_an_unknown_kind_of_opengl_is_named(monkeypatch):
    code = (
        "from lacoloco_cli.failures import explain\n"
        "try:\n    import mujoco\n"
        "except Exception as error:\n    print(explain(error))\n"
    )
    environment = {**os.environ, "MUJOCO_GL": "foo"}
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    assert ran.stdout.startswith("('MUJOCO_GL=foo: does not work here")
    assert ran.stdout.endswith(", 2)\n")


def test_bug_is_one_line_and_exit_code_1():
    result = invoke(lambda session: {}["key"])
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1
    assert "KeyError" in result.stderr and "--debug" in result.stderr


def test_debug_shows_the_traceback():
    result = invoke(lambda session: {}["key"], "--debug")
    assert result.exit_code == 1
    assert "Traceback (most recent call last)" in result.stderr


def test_error_is_an_object_with_json():
    def body(session: Session) -> None:
        raise StageError("low level is for h1; use --robot h1")

    result = invoke(body, "--json")
    assert result.exit_code == 2
    failure = {"error": "low level is for h1; use --robot h1", "exit_code": 2}
    assert json.loads(result.stdout) == failure
    assert result.stderr.startswith("error: ")


def test_interruption_prints_the_command_that_continues():
    def body(session: Session) -> None:
        begin(session)
        raise KeyboardInterrupt

    result = invoke_as("train-low", body, "--run", "dog")
    assert result.exit_code == 130
    assert result.stderr == "interrupted; continue with: lacoloco train-low --run dog --resume\n"


@pytest.mark.parametrize(
    ("settings", "said"),
    [({}, "nothing was begun"), ({"shared": AT_ONCE}, "nothing is kept"),
     ({"shared": READING}, "nothing is kept")],
)  # fmt: skip
def test_an_interruption_with_nothing_to_continue_says_so(settings, said):
    def body(session: Session) -> None:
        raise KeyboardInterrupt

    result = invoke(body, **settings)
    assert result.exit_code == 130
    assert said in result.stderr and "--resume" not in result.stderr


def test_a_stage_that_keeps_nothing_refuses_to_resume():
    result = invoke(lambda session: pytest.fail("it ran"), "--resume", shared=AT_ONCE)
    assert result.exit_code == 2
    assert "keeps nothing to go on with" in result.stderr
    assert "--resume" not in invoke(lambda session: None, "--help", shared=AT_ONCE).stdout


def test_resume_needs_no_other_argument():
    calls = []

    def body(
        session: Session,
        motions: Annotated[list[Path] | None, typer.Argument()] = None,
        disc: Annotated[str, typer.Option("--disc")] = "drail",
        constrained: Annotated[bool, typer.Option("--cat/--no-cat")] = True,
    ) -> None:
        config = session.config(PRESETS)
        begin(session, config=config)
        calls.append((session.context(), config, motions, disc, constrained))

    typed = ["a.h5", "--run", "dog", "--disc", "gan", "--no-cat", "--seed", "4"]
    typed += ["--preset", "smoke", "--set", "samples=7"]
    invoke_as("train-low", body, *typed)
    invoke_as("train-low", body, "--run", "cat")
    invoke_as("train-low", body, "--run", "dog", "--resume", "--quiet")
    first, _, resumed = calls
    assert resumed[1:] == first[1:] == (Config(7), [Path("a.h5")], "gan", False)
    assert (resumed[0].seed, resumed[0].run, resumed[0].resume) == (4, "dog", True)
    for word in typed:
        assert word in resumed[0].command


def test_an_own_option_may_name_the_run():
    runs = []

    def body(
        session: Session, name: Annotated[str | None, typer.Argument()] = None, seeds: int = 1
    ) -> None:
        runs.append((session.context().run, name, seeds))
        session.remember()

    def call(*arguments):
        app = command_of(body, names_run="name", several_stages=True)
        CliRunner().invoke(app, arguments, obj={"arguments": ["run", *arguments]}, prog_name="run")

    call("dog", "--seeds", "3")
    call("cat", "--seeds", "2")
    call("dog", "--resume")
    call("--resume")
    call("dog", "--run", "mine")
    assert runs == [("dog", "dog", 3), ("cat", "cat", 2), ("dog", "dog", 3), ("dog", "dog", 3),
                    ("mine", "dog", 1)]  # fmt: skip


def test_of_several_unfinished_versions_one_can_be_chosen():
    """Bare, it is the newest; each goes on with its own settings."""
    seen = []

    def body(session: Session) -> None:
        config = session.config(PRESETS)
        begin(session, config=config)
        seen.append((session.seed, config.samples, session.version))

    invoke_as("train-low", body, "--set", "samples=3")
    invoke_as("train-low", body, "--set", "samples=5", "--seed", "4")
    invoke_as("train-low", body, "--set", "samples=7")
    for typed in (["--resume"], ["--resume", "2"], ["--resume=0001"], ["--resume", "--seed", "4"]):
        result = invoke_as("train-low", body, *typed)
        assert result.exit_code == 0, result.stderr
    assert seen[3:] == [(0, 7, "0003"), (4, 5, "0002"), (0, 3, "0001"), (4, 5, "0002")]
    missing = invoke_as("train-low", body, "--resume", "9")
    assert missing.exit_code == 2
    assert "unfinished: 0001, 0002, 0003" in missing.stderr


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        (["--set", "samples=9"], "samples was 3, is 9"),
        (["--preset", "smoke", "--set", "samples=9"], "samples was 3, is 9"),
        (["--seed", "5", "--set", "samples=3"], "seed was 0, is 5"),
    ],
)
def test_other_work_is_not_resumed(typed, said):
    """A training at one learning rate never goes on with another one's."""

    def body(session: Session) -> None:
        begin(session, config=session.config(PRESETS))

    assert invoke_as("train-low", body, "--set", "samples=3").exit_code == 0
    refused = invoke_as("train-low", body, "--resume", *typed)
    assert refused.exit_code == 2
    assert said in refused.stderr and refused.stderr.count("\n") == 1
    assert invoke_as("train-low", body, "--resume").exit_code == 0


def test_a_mistyped_call_in_between_changes_nothing():
    seen = []

    def body(session: Session) -> None:
        config = session.config(PRESETS)
        begin(session, config=config)
        seen.append(config.samples)

    invoke_as("train-low", body, "--set", "samples=3")
    assert invoke_as("train-low", body, "--set", "sample=4").exit_code == 2
    assert invoke_as("train-low", body, "--resume").exit_code == 0
    assert seen == [3, 3]


def test_resume_of_one_verb_takes_nothing_from_another():
    def body(session: Session) -> None:
        begin(session, session.verb)

    invoke_as("train-low", body, "--seed", "4")
    result = invoke_as("train-high", body, "--resume")
    assert result.exit_code == 2
    assert "no unfinished version of train-high" in result.stderr


def test_a_version_that_another_verb_began_is_resumed_by_it():
    invoke_as("run", lambda session: begin(session, "train-low"))
    result = invoke_as("train-low", lambda session: pytest.fail("it ran"), "--resume")
    assert result.exit_code == 2
    assert "continue with `lacoloco run --run default --resume`" in result.stderr


def test_body_may_answer_and_still_choose_its_exit_code():
    def body(session: Session) -> None:
        session.answer({"ok": False})
        raise typer.Exit(2)

    result = invoke(body, "--json", shared=READING)
    assert result.exit_code == 2
    assert json.loads(result.stdout) == {"ok": False}


def test_unknown_preset_lists_the_known_ones():
    result = invoke(lambda session: session.config(PRESETS), "--preset", "large")
    assert result.exit_code == 2
    assert "--preset large" in result.stderr and "smoke, laptop" in result.stderr


def test_unknown_key_is_a_mistake_of_the_user():
    result = invoke(lambda session: session.config(PRESETS), "--set", "sample=1")
    assert result.exit_code == 2
    assert "'samples'" in result.stderr


@pytest.mark.parametrize("device", ["tpu", "cuda"])
def test_device_that_is_not_there_is_refused(device, monkeypatch):
    import torch

    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    result = invoke(lambda session: session.context(), "--device", device)
    assert result.exit_code == 2
    assert f"--device {device}" in result.stderr


def test_read_only_runs_folder_is_one_line_that_names_it(read_only_folder, monkeypatch):
    monkeypatch.setenv("LACOLOCO_RUNS", str(read_only_folder / "runs"))
    result = invoke(lambda session: session.context())
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert str(read_only_folder) in result.stderr


def test_run_defaults_to_the_one_used_last():
    names = []

    def body(session: Session) -> None:
        context = session.context()
        context.begin("retarget", context.work(Config(), RobotRecord("", "")))
        names.append(context.run)

    for arguments in ([], ["--run", "dog"], [], ["--run", "cat"], []):
        assert invoke(body, *arguments).exit_code == 0
    assert names == ["default", "dog", "dog", "cat", "cat"]


def test_context_carries_the_options():
    contexts = []
    body = lambda session: contexts.append(session.context())  # noqa: E731
    arguments = ["--seed", "3", "--resume", "--quiet"]
    result = invoke(body, *arguments, several_stages=True)
    assert result.exit_code == 0, result.output
    (context,) = contexts
    assert (context.seed, context.device, context.resume) == (3, "cpu", True)
    assert context.command.startswith("lacoloco")
