import shlex

import pytest
import typer.main
from typer.testing import CliRunner

from lacoloco.datasets.store import RunStore
from lacoloco_cli.examples import EXAMPLES
from lacoloco_cli.main import VERBS, app


def invoke(*arguments, env=None):
    return CliRunner().invoke(app, list(arguments), env=env)


def parts(verb):
    """The verb, and its sub-commands as the command line names them."""
    command = typer.main.get_command(app).resolve_command(None, [verb])[1]
    return [verb, *(f"{verb} {name}" for name in getattr(command, "commands", ()))]


@pytest.mark.parametrize("verb", VERBS)
def test_the_help_of_every_verb_ends_with_two_examples_that_parse(verb):
    for part in parts(verb):
        shown = invoke(*part.split(), "--help").stdout
        assert len(EXAMPLES[part]) == 2
        for line in EXAMPLES[part]:
            assert line in shown
            parse(line, verb=part)


def parse(line, verb):
    assert line.startswith(f"lacoloco {verb}")
    words = shlex.split(line)[1:]
    command, context = typer.main.get_command(app), None
    while hasattr(command, "resolve_command"):
        name, command, words = command.resolve_command(context, words)
    command.make_context(name, words)  # refuses an option that is not there


def test_the_help_of_run_lists_the_experiments():
    from lacoloco.pipelines.chains.experiments import EXPERIMENTS
    from lacoloco_cli.run import NAMES

    assert set(NAMES) - {"table-1"} == set(EXPERIMENTS)


def test_the_completed_presets_are_those_that_the_stages_have():
    from lacoloco.pipelines import train_low
    from lacoloco_cli.completion import PRESETS

    assert set(PRESETS) == set(train_low.PRESETS)


def test_the_help_of_train_low_says_which_motions_it_takes():
    words = invoke("train-low", "--help").stdout.replace("│", " ").split()
    assert "default: the run's newest generated ones" in " ".join(words)


def test_brackets_in_help_are_shown_and_paragraphs_are_as_wide_as_the_terminal():
    shown = invoke("explore", "--help", env={"COLUMNS": "200"}).stdout
    assert "pip install 'lacoloco[explore]'" in shown
    paragraph = next(line for line in shown.splitlines() if "Drag the sliders" in line)
    assert len(paragraph.strip()) > 150
    assert "'lacoloco[video]'" in invoke("play", "--help", env={"COLUMNS": "200"}).stdout


@pytest.mark.parametrize(
    ("line", "completed"),
    [
        ("lacoloco trai", ["train-low", "train-high"]),
        ("lacoloco runs pa", ["page"]),
        ("lacoloco play --cam", ["--camera"]),
        ("lacoloco play --camera f", ["follow", "fixed"]),
        ("lacoloco play solo12-synthetic", ["solo12-synthetic", "solo12-synthetic-low"]),
        ("lacoloco train-high --low h1-s", ["h1-synthetic"]),
        ("lacoloco runs show se", ["seen"]),
        ("lacoloco train-low --run se", ["seen"]),
        ("lacoloco train-low --preset s", ["smoke"]),
        ("lacoloco generate --robot solo", ["solo12"]),
        ("lacoloco run quick", ["quickstart"]),
    ],
)
def test_a_shell_completes_verbs_options_and_values(line, completed):
    (RunStore().root / "seen").mkdir(parents=True)
    env = {"COMP_WORDS": line, "COMP_CWORD": str(line.count(" "))}
    result = invoke(env={"_LACOLOCO_COMPLETE": "complete_bash", **env})
    assert result.stdout.split() == completed
