"""The kill test: every verb is killed at random moments, and goes on as if nothing had been.

`make test` kills a few, `make soak` many: `python tests/test_soak.py KILLS SEED [VERB...]`. The
moments of a seed are always the same; where a call is by then depends on the machine. Half of the
kills come after a time, half before a certain access to the disk.
"""

from __future__ import annotations

import collections
import dataclasses
import hashlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

os.environ.setdefault("OMP_NUM_THREADS", "1")
CHECKOUT = Path(__file__).parents[1]
SECONDS = 900.0
"""For one call, on a busy machine; more is a hang."""
TOUCHES = ("open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.listdir", "os.scandir")
"""Events of Python at which a call is about to read or change the disk."""
ARTIFACT = "artifact.h5"
KEPT_NAMES = re.compile(r"\.numbering|\.last|\.[\w-]+\.arguments\.json")
"""Hidden files that belong among runs."""
OF_THE_CALL = re.compile(
    r"(.*_)?seconds|.*per_second.*|times_real_time|elapsed.*|sha256|.*path|key|hardware|html|kept"
)
"""Entries that tell of the call, not of what it computed."""
VERSION_NAME = re.compile(r"/\d{4}\b")
NOTHING = ("no unfinished", "nothing to resume")
"""What `--resume` says where nothing was begun, or all was completed."""


@dataclasses.dataclass(frozen=True)
class Verb:
    """One command, and the stages it makes a version of."""

    arguments: tuple[str, ...]
    stages: tuple[str, ...]
    resumes: bool = True

    @property
    def run(self) -> str:
        """The run it works in."""
        return "other" if self.arguments[0] == "run" else "dog"

    def command(self) -> list[str]:
        """All arguments of a new call."""
        return [*self.arguments, "--run", self.run, "--preset", "smoke", "--json", "--quiet"]

    def resume(self) -> list[str]:
        """All arguments of the call that goes on; those of a chain may be given again."""
        if self.arguments[0] == "run":
            return [*self.command(), "--resume"]
        return [self.arguments[0], "--run", self.run, "--resume", "--json", "--quiet"]


VERBS = {
    "generate": Verb(("generate", "--retrain"), ("experts", "generate")),
    "retarget": Verb(("retarget", "mocap", "--force", "--jobs", "1"), ("retarget",)),
    "track": Verb(("track",), ("track",)),
    "train-low": Verb(("train-low",), ("train-low",)),
    "train-high": Verb(("train-high",), ("train-high",)),
    "eval": Verb(("eval",), ("eval",), resumes=False),
    "switching": Verb(("switching",), ("switching",), resumes=False),
    "export": Verb(("export",), ("export",), resumes=False),
    "play": Verb(("play", "--html", "page.html"), ("play",), resumes=False),
    "run": Verb(("run", "quickstart"), ("train-high", "eval", "export", "play")),
}
"""In the order of the chain: each takes what those before it made."""


@dataclasses.dataclass(frozen=True)
class Moment:
    """When a call is killed: after some seconds, or before its access number `touch`."""

    seconds: float = SECONDS
    touch: int = -1


@dataclasses.dataclass(frozen=True)
class Ended:
    """How a call ended: exit code (-9 killed, -15 hanging), what it printed, how long it took."""

    code: int
    out: str
    err: str
    seconds: float
    touches: int


def call(folder: Path, arguments: list[str], moment: Moment | None = None) -> Ended:
    """One call of `lacoloco` in a process of its own, forked from this one: all is imported."""
    files = {name: folder / f"{name}.txt" for name in ("out", "err", "touches")}
    for file in files.values():
        file.write_text("")
    begin = time.monotonic()
    process = os.fork()
    if process == 0:
        _become(folder, arguments, files, moment.touch if moment else -1)
    limit = begin + (moment.seconds if moment else SECONDS)
    status: int | None = None
    while status is None and time.monotonic() < limit:
        done, ended = os.waitpid(process, os.WNOHANG)
        status = ended if done else None
        time.sleep(0 if done else 0.002)
    hangs = status is None and limit >= begin + SECONDS
    if status is None:
        os.kill(process, signal.SIGKILL)
        status = os.waitpid(process, 0)[1]
    code = -signal.SIGTERM if hangs else os.waitstatus_to_exitcode(status)
    out, err, touches = (file.read_text(errors="replace") for file in files.values())
    return Ended(code, out, err, time.monotonic() - begin, int(touches or 0))


def _become(folder: Path, arguments: list[str], files: dict[str, Path], last: int) -> None:
    """In the forked process: be `lacoloco`, killed before the given access to the disk."""
    from lacoloco_cli.entry import run

    code = 70
    try:
        for number, name in ((1, "out"), (2, "err")):
            os.dup2(os.open(files[name], os.O_WRONLY), number)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        os.chdir(folder)
        os.environ["LACOLOCO_RUNS"] = "runs"
        count = 0

        def touched(event: str, about: tuple[Any, ...]) -> None:
            nonlocal count
            if event in TOUCHES and about and _in_runs(about[0]):
                if count == last:
                    os.kill(os.getpid(), signal.SIGKILL)
                count += 1

        sys.addaudithook(touched)
        sys.argv = ["lacoloco", *arguments]
        try:
            run()
        except SystemExit as error:
            code = error.code if isinstance(error.code, int) else 1 if error.code else 0
        files["touches"].write_text(str(count))
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def _in_runs(place: object) -> bool:
    return isinstance(place, (str, Path)) and "runs/" in f"{os.fspath(place)}/"


def complete(runs: Path) -> list[Path]:
    """The directories of all complete versions."""
    return sorted(path for path in runs.glob("*/*/*") if path.name.isdecimal())


def snapshot(runs: Path) -> dict[str, str]:
    """SHA-256 of every file in a complete version that is there to stay."""
    from lacoloco.datasets.beside import is_working

    return {
        str(file.relative_to(runs)): hashlib.sha256(file.read_bytes()).hexdigest()
        for version in complete(runs)
        for file in sorted(version.rglob("*"))
        if file.is_file() and not is_working(file.relative_to(version).parts[0])
    }


def computed(version: Path) -> str:
    """All that a version computed: arrays, metrics, the log of its training, names of files.

    A verb that is given again instead of resumed makes the next version, and what is made from it
    names that one.
    """
    from lacoloco.datasets.artifact import read_artifact

    artifact = read_artifact(version / ARTIFACT)
    log = version / "metrics.jsonl"
    rows = [json.loads(line) for line in log.read_text().splitlines()] if log.is_file() else []
    names = sorted(file.name for file in version.rglob("*") if "tfevents" not in file.name)
    told = [artifact.data_hash, _metrics(artifact.metadata), _metrics(rows), names]
    return VERSION_NAME.sub("/....", json.dumps(told, sort_keys=True))


def _metrics(value: Any) -> Any:
    if isinstance(value, dict):
        return {
            key: _metrics(inner) for key, inner in value.items() if not OF_THE_CALL.fullmatch(key)
        }
    return [_metrics(inner) for inner in value] if isinstance(value, list) else value


def broken(runs: Path) -> list[str]:
    """What is not whole among the complete versions."""
    from lacoloco.datasets.artifact import read_artifact
    from lacoloco.datasets.beside import compare
    from lacoloco.datasets.errors import ArtifactError

    found = []
    for version in complete(runs):
        try:
            beside = compare(version, read_artifact(version / ARTIFACT).files)
            if beside.missing or beside.changed or beside.unknown:
                found.append(f"half: {version}: {beside}")
        except ArtifactError as error:
            found.append(f"half: {error}")
    return found


def left(runs: Path) -> list[str]:
    """What lies among runs and belongs to no complete version."""
    return [
        f"left: {path}"
        for path in sorted(runs.rglob("*"))
        if path.name.startswith(".") and not KEPT_NAMES.fullmatch(path.name)
    ]


@dataclasses.dataclass
class Sound:
    """An undisturbed chain: what each verb computed, how long it took, how often it touched."""

    folder: Path
    computed: dict[str, list[str]] = dataclasses.field(default_factory=dict)
    ended: dict[str, Ended] = dataclasses.field(default_factory=dict)

    def make(self, verbs: list[str]) -> None:
        """Run the verbs up to the last one that is wanted, in their order."""
        (self.folder / "mocap").mkdir(parents=True)
        lines = (CHECKOUT / "datasets/samples/dog_walk_trot_turn.bvh").read_text().splitlines()
        first = next(i for i, line in enumerate(lines) if line.startswith("Frames:"))
        for name, frames in (("short", 60), ("shorter", 45)):
            text = "\n".join(
                [*lines[:first], f"Frames: {frames}", *lines[first + 1 :][: frames + 1]]
            )
            (self.folder / f"mocap/{name}.bvh").write_text(text + "\n")
        for name in list(VERBS)[: 1 + max(list(VERBS).index(verb) for verb in verbs)]:
            verb = VERBS[name]
            ended = call(self.folder, verb.command())
            if ended.code:
                raise SystemExit(f"undisturbed {name}: {ended.err}")
            self.ended[name] = ended
            runs = self.folder / "runs"
            self.computed[name] = [
                computed(path.parent)
                for stage in verb.stages
                for path in sorted((runs / verb.run / stage).glob(f"*/{ARTIFACT}"))
            ]
            if verb.run == "other":  # it would keep what is there
                shutil.rmtree(runs / "other")


def one_kill(sound: Sound, folder: Path, name: str, chance: random.Random) -> Iterator[str]:
    """Kill a verb, perhaps kill what goes on with it, and let it end.

    Yields:
        What was done (in brackets), and what should not be.
    """
    shutil.copytree(sound.folder, folder, dirs_exist_ok=True)
    verb, runs = VERBS[name], folder / "runs"
    page, before = folder / "page.html", snapshot(runs)
    kept = set(before)
    command = verb.command()
    chances = [1.0, 0.3, 0.1, 0.0]
    killed = True
    while killed:
        moment = _moment(sound.ended[name], chance) if chance.random() < chances.pop(0) else None
        ended = call(folder, command, moment)
        if command != verb.command() and ended.code == 2 and any(t in ended.err for t in NOTHING):
            command = verb.command()
            ended = call(folder, command, moment)
        killed = ended.code == -signal.SIGKILL
        yield f"[{'killed' if killed else 'ended'} after {ended.seconds:.1f} s, {moment}]"
        if ended.code == -signal.SIGTERM:
            yield f"hang: {command}"
        elif not killed and (ended.code or "Traceback" in ended.err):
            kind = "traceback" if ended.code == 1 or "Traceback" in ended.err else "refused"
            yield f"{kind}: {command}: {ended.err}"
        now = snapshot(runs)
        yield from (f"lost: {file}" for file in before if now.get(file) != before[file])
        yield from broken(runs)
        if page.exists() and b"</html>" not in page.read_bytes()[-100:]:
            yield f"half: {page}"
        before = now
        if killed and verb.resumes and chance.random() < 0.7:
            command = verb.resume()
    yield from _cleaned(folder)
    made = [
        version
        for version in complete(runs)
        if f"{version.relative_to(runs)}/{ARTIFACT}" not in kept
    ]
    expected = sound.computed[name]
    if not made:
        yield f"lost: {name} made nothing"
    for version in made:
        if version.parent.name in verb.stages and (told := computed(version)) not in expected:
            nearest = max(expected, key=lambda other: len(os.path.commonprefix([told, other])))
            yield f"different: {version}: {_difference(told, nearest)}"


def _moment(usual: Ended, chance: random.Random) -> Moment:
    if chance.random() < 0.5:
        return Moment(touch=chance.randrange(usual.touches))
    return Moment(seconds=chance.uniform(0, usual.seconds))


def _difference(one: str, other: str) -> str:
    place = len(os.path.commonprefix([one, other]))
    span = slice(max(place - 80, 0), place + 80)
    return f"...{one[span]}... is not ...{other[span]}..."


def _cleaned(folder: Path) -> Iterator[str]:
    runs = folder / "runs"
    before = snapshot(runs)
    for arguments in (["runs", "clean", "--yes"], ["runs", "verify"]):
        ended = call(folder, [*arguments, "--json"])
        if ended.code:
            yield f"refused: {arguments}: {ended.out} {ended.err}"
    if snapshot(runs) != before:
        yield "lost: by runs clean"
    yield from left(runs)


def soak(kills: int, seed: int, verbs: list[str]) -> int:
    """Kill so many times, the verbs in turns; print each kill, what was found, and the metrics."""
    from lacoloco.pipelines.training import loop

    _import_everything()
    loop.CHECKPOINT_SECONDS = 0.0  # a smoke training is over before its first checkpoint
    begin, counts = time.monotonic(), collections.Counter[str]()
    with tempfile.TemporaryDirectory(prefix="lacoloco-soak-") as place:
        sound = Sound(Path(place) / "sound")
        sound.make(verbs)
        while counts["kills"] < kills:
            number = counts["trials"]
            name, chance = verbs[number % len(verbs)], random.Random(f"{seed} {number}")
            folder = Path(place) / "trial"
            told = list(one_kill(sound, folder, name, chance))
            shutil.rmtree(folder)
            counts["trials"] += 1
            counts["kills"] += sum(line.startswith("[killed") for line in told)
            counts.update(line.split(":")[0] for line in told if line[0] != "[")
            print(f"{number} {name}: {' '.join(told)}", flush=True)  # noqa: T201
    found = {key: counts[key] for key in sorted(set(counts) - {"kills", "trials"})}
    names = ("lost", "half", "different", "left", "refused", "traceback", "hang")
    metrics = ", ".join(f"{key} {counts[key]}" for key in names)
    seconds = time.monotonic() - begin
    print(f"{counts['kills']} kills, {counts['trials']} calls: {metrics}; {seconds:.0f} s")  # noqa: T201
    return 1 if found else 0


def _import_everything() -> None:
    from importlib import import_module

    import onnxruntime  # noqa: F401
    import torch.onnx
    import torch.utils.tensorboard  # noqa: F401

    from lacoloco.pipelines.chains.experiments import STAGES
    from lacoloco_cli.main import VERBS as MODULES

    for module in (*STAGES.values(), "switching"):
        import_module(f"lacoloco.pipelines.{module}")
    for module, _ in MODULES.values():
        import_module(f"lacoloco_cli.{module}")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="processes are forked")
def test_killed_stages_lose_nothing_and_end_as_if_they_had_not_been(tmp_path):
    command = [sys.executable, __file__, "4", "0", "generate", "retarget"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    kills = re.search(r"^(\d+) kills", ended.stdout, re.MULTILINE)
    assert kills is not None
    assert int(kills[1]) >= 4


if __name__ == "__main__":
    arguments = sys.argv[1:]
    numbers = [int(argument) for argument in arguments[:2]]
    sys.exit(soak(*(numbers + [200, 0][len(numbers) :]), arguments[2:] or list(VERBS)))
