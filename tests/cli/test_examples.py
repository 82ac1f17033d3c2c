import shlex

import pytest
import typer.main
from typer.testing import CliRunner

from lacoloco_cli.examples import EXAMPLES
from lacoloco_cli.main import VERBS, app


def invoke(*arguments, env=None):
    return CliRunner().invoke(app, list(arguments), env=env)


@pytest.mark.parametrize("verb", VERBS)
def test_the_help_of_every_verb_ends_with_two_examples_that_parse(verb):
    assert len(EXAMPLES[verb]) == 2
    shown = invoke(verb, "--help").stdout
    for line in EXAMPLES[verb]:
        assert line in shown
        program, *words = shlex.split(line)
        assert (program, words[0]) == ("lacoloco", verb)
        command, context = typer.main.get_command(app), None
        while hasattr(command, "resolve_command"):
            name, command, words = command.resolve_command(context, words)
        command.make_context(name, words)  # refuses an option that is not there


def test_the_help_of_run_lists_the_experiments():
    from lacoloco.pipelines.chains.experiments import EXPERIMENTS
    from lacoloco_cli.run import NAMES

    assert set(NAMES) - {"table-1"} == set(EXPERIMENTS)


def test_the_help_of_train_low_says_which_motions_it_takes():
    words = invoke("train-low", "--help").stdout.replace("│", " ").split()
    assert "default: the run's newest generated ones" in " ".join(words)


@pytest.mark.parametrize(
    ("line", "completed"),
    [("lacoloco trai", ["train-low", "train-high"]), ("lacoloco play --cam", ["--camera"])],
)
def test_a_shell_completes_verbs_and_options(line, completed):
    env = {"COMP_WORDS": line, "COMP_CWORD": str(line.count(" "))}
    result = invoke(env={"_LACOLOCO_COMPLETE": "complete_bash", **env})
    assert result.stdout.split() == completed
