from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from lacoloco_cli.main import ROBOT_OF, VERBS, app

HEAVY = ("torch", "numpy", "h5py", "mujoco", "pinocchio", "casadi", "meshcat", "onnx")


def invoke(*arguments):
    return CliRunner().invoke(app, list(arguments))


def test_help_lists_every_verb_in_the_order_of_the_chain():
    result = invoke("--help")
    assert result.exit_code == 0
    lines = [line.split() for line in result.stdout.splitlines()]
    listed = [next((word for word in words if word.isascii()), "") for words in lines]
    assert [name for name in listed if name in VERBS] == list(VERBS)


def test_no_arguments_is_help():
    assert invoke().stdout == invoke("--help").stdout


def test_help_imports_nothing_heavy():
    code = (
        "import sys\n"
        "from lacoloco_cli.main import app\n"
        "try:\n    app(['--help'])\n"
        "except SystemExit:\n    pass\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stderr.strip() == "[]"


def test_version():
    assert invoke("--version").stdout.startswith("lacoloco 0.")


def test_misspelt_verb_is_refused_with_the_nearest():
    result = invoke("retraget")
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith("error: ") and "'retarget'" in result.stderr


def test_an_argument_that_is_no_text_is_refused():
    result = invoke("retarget", "walk\udcff.bvh")
    assert result.exit_code == 2
    assert result.stderr == "error: walk\\udcff.bvh: is no UTF-8 text; rename the file\n"


def test_misspelt_option_is_one_line_also_as_json():
    result = invoke("doctor", "--jsn", "--json")
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    failure = json.loads(result.stdout)
    assert failure["exit_code"] == 2 and "--jsn" in failure["error"]


@pytest.mark.parametrize("name", VERBS)
def test_every_verb_answers_help(name):
    result = invoke(name, "--help")
    assert result.exit_code == 0, result.output
    assert f"lacoloco {name}" in result.stdout
    assert "--install-completion" not in result.stdout


class Interrupting:
    """A module that is interrupted while it is imported."""

    def find_spec(self, name, path=None, target=None):
        if name in ("lacoloco_cli.main", "lacoloco_cli.doctor"):
            raise KeyboardInterrupt
        return None


@pytest.mark.parametrize(
    ("module", "told"), [("lacoloco_cli.main", "interrupted\n"), ("lacoloco_cli.doctor", "")]
)
def test_ctrl_c_while_python_still_imports_prints_no_traceback(module, told, monkeypatch, capsys):
    from lacoloco_cli import entry

    monkeypatch.delitem(sys.modules, module, raising=False)
    monkeypatch.setattr(sys, "meta_path", [Interrupting(), *sys.meta_path])
    monkeypatch.setattr(sys, "argv", ["lacoloco", "doctor"])
    with pytest.raises(SystemExit) as caught:
        entry.run()
    assert caught.value.code == 130
    assert capsys.readouterr().err == told


@pytest.mark.parametrize("verb", ROBOT_OF)
def test_a_verb_whose_input_brings_the_robot_says_so(verb):
    help_text = invoke(verb, "--help").stdout
    assert "--robot" not in help_text
    result = invoke(verb, "--robot", "solo12", "--json")
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    line = f"--robot: {verb} takes the robot from {ROBOT_OF[verb]}; leave the option out"
    assert json.loads(result.stdout)["error"] == line
    for option in re.findall(r"\((--[a-z]+)\)", ROBOT_OF[verb]):
        assert option in help_text
