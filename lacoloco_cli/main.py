"""`lacoloco`: the verbs, in the order of the chain; each is imported only when it is called."""

from __future__ import annotations

import inspect
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from typing import Annotated, Any, NoReturn

import typer
import typer.core
import typer.main

from lacoloco_cli.completion import complete_values
from lacoloco_cli.examples import epilog
from lacoloco_cli.failures import USER_MISTAKE, UserError, explain

VERBS = {
    "generate": ("generate", "Record motions of expert policies, trained if need be."),
    "retarget": ("retarget", "Turn motion capture (.bvh) into motions of the robot."),
    "motions": ("motions", "List, show, draw, import and export motions."),
    "track": ("track", "Let a robot perform retargeted motions in simulation."),
    "train-low": ("train_low", "Train the low level: latents to motion (ASE)."),
    "train-high": ("train_high", "Train the high level: a target to latents."),
    "eval": ("evaluate", "Measure error, falls and violations: the paper's Table I."),
    "switching": ("switching", "Count and draw how a policy switches from walking to reaching."),
    "export": ("export", "Write both levels as ONNX that was checked against torch."),
    "play": ("play", "Watch a motion or a policy in the browser or as HTML."),
    "explore": ("explore", "Steer a low level by hand, live in the browser."),
    "run": ("run", "Run a whole experiment, e.g. quickstart or solo12-dog."),
    "runs": ("runs", "List, show, plot, report, verify and publish what lies in runs/."),
    "robots": ("robots", "List, show, import and check robots."),
    "bench": ("bench", "Measure speed next to the raw engine."),
    "doctor": ("doctor", "Check the installation; say which engine is used."),
}
"""Verb -> (module of `lacoloco_cli` with its `app`, one line of help)."""
ROBOT_OF = {
    "track": "its motions (--motions)",
    "train-low": "its motions (--motions)",
    "train-high": "its low-level policy (--low)",
    "eval": "its policies (--policy)",
    "switching": "its policy (--policy)",
    "export": "its policy (--policy)",
    "play": "the artifact that is played",
    "explore": "the policy that is explored",
}
"""Verb without `--robot` -> what brings its robot."""


class FrontDoor(typer.core.TyperGroup):
    """A group that knows its verbs by name and help, and imports one only to call it."""

    def __init__(self, **attributes: Any) -> None:
        """List the verbs without importing them."""
        super().__init__(**attributes)
        for name, (_, help_line) in VERBS.items():
            self.add_command(typer.core.TyperCommand(name=name, help=help_line))

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[Any, Any, list[str]]:
        """Exchange the listed verb for the real one."""
        name, command, rest = super().resolve_command(ctx, args)
        if name in VERBS:
            module = import_module(f"lacoloco_cli.{VERBS[name][0]}")
            command = typer.main.get_command(module.app)
            command.name = name
            # typer adds these to every app; a verb has no completion of its own
            completion = ("install_completion", "show_completion")
            command.params = [p for p in command.params if p.name not in completion]
            finish(command, name)
        return name, command, rest

    def main(self, args: Sequence[str] | None = None, *_: Any, **extra: Any) -> NoReturn:
        """Run, and end a mistake in the command line itself with one line and exit code 2."""
        arguments = list(sys.argv[1:] if args is None else args)
        extra |= {"standalone_mode": False, "obj": {"arguments": arguments}}
        try:
            _check_texts(arguments)
            code = super().main(args=arguments or ["--help"], **extra)
        except Exception as error:  # a usage error, or a verb that cannot even be imported
            code = _refuse(error, arguments)
        sys.exit(code if isinstance(code, int) else 0)


def finish(command: Any, verb: str) -> None:
    """Give a verb and its sub-commands what the help shows, and what the tab key completes."""
    from rich.markup import escape

    command.epilog = command.epilog or epilog(verb)
    command.help = escape(flowing(command.help or ""))
    for parameter in command.params:  # 'lacoloco[video]' is no markup
        parameter.help = escape(getattr(parameter, "help", None) or "")
    complete_values(command)
    for name, part in getattr(command, "commands", {}).items():
        finish(part, f"{verb} {name}")


def flowing(text: str) -> str:
    """A text whose paragraphs are a line each, so that they are wrapped as wide as the terminal."""
    paragraphs = inspect.cleandoc(text).split("\n\n")
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)


def _check_texts(arguments: Sequence[str]) -> None:
    """Refuse what is no text: names of files may be, but not what is written into artifacts."""
    for argument in arguments:
        try:
            argument.encode()
        except UnicodeEncodeError:
            shown = argument.encode(errors="backslashreplace").decode()
            raise UserError(f"{shown}: is no UTF-8 text; rename the file") from None


def _refuse(error: Exception, arguments: Sequence[str]) -> int:
    if type(error).__name__ == "NoArgsIsHelpError":  # its message is the help text
        typer.echo(str(error), err=True)
        return USER_MISTAKE
    if "--debug" in arguments:
        traceback.print_exception(error)
    line, code = explain(error)
    verb = arguments[0] if arguments else ""
    if getattr(error, "option_name", "") == "--robot" and verb in ROBOT_OF:
        line = f"--robot: {verb} takes the robot from {ROBOT_OF[verb]}; leave the option out"
    typer.echo(f"error: {line}", err=True)
    if "--json" in arguments:
        from lacoloco_cli.json_output import to_json

        typer.echo(to_json({"error": line, "exit_code": code}))
    return code


app = typer.Typer(
    name="lacoloco",
    cls=FrontDoor,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="From example motions to a legged robot that walks to a point and touches it.",
    epilog="The chain: generate or retarget and track, train-low, train-high, eval, export, play.",
)


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"lacoloco {version('lacoloco')}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print and exit."),
    ] = False,
) -> None:
    """Take the options that come before the verb."""
