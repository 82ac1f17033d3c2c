"""One call of a verb: its options, its output, and how it ends.

A verb is a function that takes a `Session` and its own options; `verb` adds the shared options,
runs it and turns whatever happens into one line and an exit code.
"""

from __future__ import annotations

import inspect
import os
import shlex
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import cached_property
from inspect import Parameter
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import typer

from lacoloco_cli import console, options
from lacoloco_cli.failures import INTERRUPTED, UserError, explain
from lacoloco_cli.json_output import stdout_kept_clean, to_json
from lacoloco_cli.overrides import apply_overrides
from lacoloco_cli.resume import (
    Resumable,
    arguments_of,
    fill_in,
    recall,
    remember,
    typed,
    unfinished_version,
    without_resume,
)

if TYPE_CHECKING:
    from lacoloco.datasets.store import RunStore
    from lacoloco.datasets.work import Work
    from lacoloco.pipelines.stage import Progress, StageContext

Config = TypeVar("Config")

NEXT = {
    "generate": "train-low",
    "retarget": "track",
    "track": "train-low",
    "train-low": "train-high",
    "train-high": "eval",
    "eval": "play",
}
"""Verb -> the one that takes what it made."""


@dataclass
class Session:
    """The shared options of one call, and what follows from them."""

    verb: str
    arguments: Sequence[str] = ()
    """The command line after `lacoloco`."""
    run: str | None = None
    preset: str | None = None
    overrides: Sequence[str] = ()
    show_config: bool = False
    seed: int = 0
    device: str = "cpu"
    resume: bool = False
    version: str = ""
    """Of `--resume VERSION`; then the version that is continued."""
    as_json: bool = False
    quiet: bool = False
    debug: bool = False
    resumable: bool = False
    """Whether the verb has `--resume`."""
    begun: Work | None = field(default=None, init=False)
    """With `--resume`, what the version was begun with."""
    _answer: dict[str, Any] | None = field(default=None, init=False)

    @property
    def processes(self) -> int:
        """How many processes torchrun started for this call; 1 without it."""
        return int(os.environ.get("WORLD_SIZE", "1"))

    @property
    def speaks(self) -> bool:
        """Whether this process gives the answer: the only one, or the first of torchrun's."""
        return self.processes == 1 or os.environ.get("RANK", "0") == "0"

    @cached_property
    def store(self) -> RunStore:
        """The run directories of the working directory, or of `$LACOLOCO_RUNS`."""
        from lacoloco.datasets.store import RunStore

        return RunStore()

    @cached_property
    def run_name(self) -> str:
        """The run asked for, else the one used last, else `default`."""
        return self.run or self.store.last_run() or "default"

    @cached_property
    def progress(self) -> Progress:
        """Where the stage shows how far it is."""
        return console.progress(self.quiet or not self.speaks)

    @property
    def command(self) -> str:
        """The command line as typed."""
        return shlex.join(["lacoloco", *self.arguments])

    def config(self, presets: Mapping[str, Callable[[], Config]]) -> Config:
        """Make the config of a stage from `--preset` and `--set`.

        Raises:
            UserError: Unknown preset (the known ones are listed), key, or type of a value.
            typer.Exit: With `--show-config`, after it was shown: the stage does not run.
        """
        if self.preset is None or self.preset not in presets:
            known = ", ".join(presets)
            raise UserError(f"--preset {self.preset}: not a preset of {self.verb}; use {known}")
        config = apply_overrides(presets[self.preset](), self.overrides)
        if self.show_config:
            self.answer_config(config)
            raise typer.Exit
        return config

    def answer_config(self, config: Any) -> None:
        """Show every key of a config with value, unit, meaning and range."""
        from lacoloco_cli.config_table import COLUMNS, keys_of, row_of

        keys = list(keys_of(config))
        self.answer(
            {"verb": self.verb, "preset": self.preset, "config": [asdict(key) for key in keys]},
            lambda: console.print_wrapped(COLUMNS, [row_of(key) for key in keys]),
        )

    def context(self, seed: int | None = None, *, resume: bool | None = None) -> StageContext:
        """Make the context that a stage runs in.

        The run becomes the one used last when a stage begins something in it: neither a call that
        fails before, nor one that only reads, leads the next verb elsewhere.

        Args:
            seed: Another seed than that of `--seed`.
            resume: Another answer than that of `--resume`.
        """
        from lacoloco.datasets.roots import check_writable
        from lacoloco.pipelines.stage import StageContext

        check_device(self.device)
        if self.speaks:
            self.store.directory(self.run_name)  # refuses what cannot be a directory name
            check_writable(self.store.root)
        return StageContext(
            store=self.store,
            run=self.run_name,
            seed=self.seed if seed is None else seed,
            device=self.device,
            resume=self.resume if resume is None else resume,
            version=self.version,
            command=self.command,
            progress=self.progress,
        )

    def takes(self, *inputs: Path) -> list[Path]:
        """Say in one line which artifacts the verb takes, before it starts; gives them back."""
        if self.speaks:
            named = ", ".join(path_text(path) for path in inputs)
            self.progress.say(f"{self.verb} of run '{self.run_name}' takes {named}")
        return list(inputs)

    def answer(
        self,
        payload: Mapping[str, Any],
        show: Callable[[], None] | None = None,
        *,
        then: str | None = None,
    ) -> None:
        """Give the result: as the JSON object with `--json`, else through `show`.

        Args:
            payload: Plain values; what `--json` prints. One answer per call.
            show: Prints the same for a person; default: one `key: value` line each.
            then: The verb that takes what this one made; default: that of ``NEXT``.
        """
        self.progress.stop()
        if not self.speaks:
            return
        if self.as_json:
            self._answer = {**(self._answer or {}), **payload}
        elif show is not None:
            show()
        else:
            for key, value in payload.items():
                typer.echo(f"{key}: {console.cell_text(value)}")
        then = then or NEXT.get(self.verb)
        if then is not None and sys.stderr.isatty() and not (self.as_json or self.quiet):
            command = ["lacoloco", then, "--run", self.run_name]
            console.note(f"next: {shlex.join(command)}")

    def how_to_continue(self) -> str:
        """What to do after an interruption."""
        if not self.resumable:
            return "nothing is kept of it; give the same command again"
        store, run = self.store, self.run_name
        if not recall(store, run, self.verb) and not store.partials(run, self.verb):
            return "nothing was begun; give the same command again"
        command = ["lacoloco", self.verb, "--run", run, "--resume"]
        return f"continue with: {shlex.join(command)}"

    def remember(self) -> None:
        """Keep the arguments of a verb that runs several stages, once they are known to be valid.

        A stage's own verb keeps them in its unfinished version.
        """
        if not (self.resume and recall(self.store, self.run_name, self.verb)):
            arguments = without_resume(self.arguments[1:])
            remember(self.store, self.run_name, self.verb, arguments)
        self.store.use(self.run_name)

    def recall(self, context: typer.Context, *, several_stages: bool) -> dict[str, Any]:
        """With `--resume`: take what was typed the first time and not again now.

        Args:
            context: The call.
            several_stages: Whether the verb runs several stages, of which none is its own.

        Returns:
            The verb's own options among them; the shared ones are taken over here.

        Raises:
            UserError: The version asked for is not there, or another verb began it.
        """
        if several_stages:
            if self.version:
                raise UserError(
                    f"--resume {self.version}: `{self.verb}` runs several stages; leave out the"
                    " version, or resume one stage with its own verb"
                )
            before = recall(self.store, self.run_name, self.verb)
        else:
            before = self._begun_with(self.seed if typed(context, "seed") else None)
        options_before = fill_in(context, before)
        self.arguments = [self.verb, *without_resume(before), *self.arguments[1:]]
        own = {}
        for name, value in options_before.items():
            if name in ("preset", "overrides", "seed", "device"):
                setattr(self, name, value)
            elif not hasattr(self, name):
                own[name] = value
        return own

    def _begun_with(self, seed: int | None) -> list[str]:
        """Choose the version to continue; the arguments that it was begun with."""
        from lacoloco.datasets.work import begun_as

        chosen = unfinished_version(self.store, self.run_name, self.verb, self.version, seed)
        if chosen is None:  # the stage says that there is nothing to resume
            return []
        self.version, self.begun = chosen.final.name, begun_as(chosen.path)
        return arguments_of(self.begun.command, self.verb, chosen.path)

    def begun_inputs(self) -> list[Path]:
        """With `--resume`: what the version was begun on, as far as it is still there."""
        inputs = (self.begun.inputs if self.begun else None) or ()
        paths = [Path(one.path) for one in inputs]
        return paths if all(path.is_file() for path in paths) else []


def verb(
    app: typer.Typer,
    name: str | None = None,
    *,
    shared: Sequence[Parameter] = options.STAGE,
    preset: str | None = None,
    names_run: str | None = None,
    torchrun: bool = False,
    several_stages: bool = False,
) -> Callable[[options.Body], options.Body]:
    """Register a function `(session, own options...)` as a command with the shared options.

    Args:
        app: The typer app of the verb's file.
        name: Name of a sub-command; a file with one command needs none.
        shared: `options.STAGE`, `options.IN_A_RUN` or `options.READING`.
        preset: Another default for `--preset`.
        names_run: The own option that names the run unless `--run` does.
        torchrun: Whether several processes can do this together.
        several_stages: Whether it runs several stages, each of which can be resumed.
    """
    resumable = any(p.name == "resume" for p in shared) and shared is not options.AT_ONCE

    def register(body: options.Body) -> options.Body:
        own = list(inspect.signature(body, eval_str=True).parameters.values())[1:]
        common = [p.replace(default=preset) if preset and p.name == "preset" else p for p in shared]
        names = {parameter.name for parameter in shared}

        def command(ctx: typer.Context, **values: Any) -> None:
            given = {key: values.pop(key) for key in names}
            given["overrides"] = given.get("overrides") or ()
            arguments = (ctx.obj or {}).get("arguments") or [ctx.info_name]
            session = Session(verb=ctx.info_name or "", arguments=arguments, **given)
            session.resumable = resumable
            session.run = session.run or values.get(names_run or "")
            with guarded(session):
                if session.processes > 1 and not torchrun:
                    raise UserError("torchrun starts only train-low and train-high; leave it out")
                if session.resume and not resumable:
                    raise UserError(
                        f"--resume: {session.verb} keeps nothing to go on with; give the command"
                        " again without it"
                    )
                if session.resume:
                    values |= session.recall(ctx, several_stages=several_stages)
                body(session, **values)

        parameters = [Parameter("ctx", Parameter.POSITIONAL_ONLY, annotation=typer.Context)]
        parameters += [p.replace(kind=Parameter.KEYWORD_ONLY) for p in (*own, *common)]
        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        command.__annotations__ = {p.name: p.annotation for p in parameters}
        command.__name__, command.__doc__ = body.__name__, body.__doc__
        app.command(name, cls=Resumable)(command)
        return body

    return register


@contextmanager
def guarded(session: Session) -> Iterator[None]:
    """Run the body of a verb; end with exit code 0, 1 (our bug), 2 (user's) or 130 (Ctrl-C).

    With `--json`, whatever the body or a library prints goes to stderr, and stdout gets exactly
    one object: the answer, or `{"error": ..., "exit_code": ...}`.
    """
    code, line = 0, ""
    with stdout_kept_clean(session.as_json):
        try:
            yield
        except BrokenPipeError:
            raise
        except typer.Exit as error:  # the body gave its answer and chose its exit code
            code = error.exit_code
        except (KeyboardInterrupt, typer.Abort):
            _stop_progress(session)
            code, line = INTERRUPTED, f"interrupted; {session.how_to_continue()}"
            console.note(line)
        except Exception as error:  # the last frame: everything becomes one line
            _stop_progress(session)
            if session.debug:
                traceback.print_exc()
            line, code = explain(error)
            console.note(f"error: {line}")
    if session.as_json and session.speaks:
        failure = {"error": line, "exit_code": code}
        typer.echo(to_json(failure if line else session._answer or {}))
    if code:
        raise typer.Exit(code)


def _stop_progress(session: Session) -> None:
    if "progress" in session.__dict__:
        session.progress.stop()


def check_device(device: str) -> None:
    """Refuse a device that is not there.

    Raises:
        UserError: Neither `cpu` nor `cuda`, or `cuda` without a CUDA device or MuJoCo Warp.
    """
    if device not in ("cpu", "cuda"):
        raise UserError(f"--device {device}: use cpu or cuda")
    if device == "cpu":
        return
    from importlib.util import find_spec

    import torch

    if not torch.cuda.is_available():
        raise UserError("--device cuda: torch finds no CUDA device; use --device cpu")
    if find_spec("mujoco_warp") is None:
        raise UserError("--device cuda: MuJoCo Warp is missing; pip install 'lacoloco[gpu]'")


def path_text(path: Path) -> str:
    """Write a path relative to the working directory when it lies below it."""
    return os.path.relpath(path) if path.resolve().is_relative_to(Path.cwd()) else str(path)
