"""Mutation fuzzing of every reader: whatever is in a file, the answer is an error of ours, soon.

`make test` tries some inputs per reader, `make fuzz` many: `python tests/test_fuzz.py INPUTS SEED`.
Input number n of a seed is always the same.
"""

from __future__ import annotations

import collections
import dataclasses
import json
import pickle
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mutations import NASTY, altered_arrays, mutated_json, mutated_text

from lacoloco.datasets.artifact import write_artifact
from lacoloco.datasets.clip import load_clips
from lacoloco.datasets.foreign.npz import npz_bytes
from lacoloco.datasets.foreign.reading import read_motion
from lacoloco.datasets.lineage import lineage
from lacoloco.datasets.mocap import load_bvh
from lacoloco.pipelines import train_high, train_low
from lacoloco.pipelines.chains.experiments import EXPERIMENTS
from lacoloco.pipelines.policies import load_policies
from lacoloco.pipelines.retargeting.mocap.selection import load_selection
from lacoloco.pipelines.retargeting.mocap.skeleton_maps import load_map
from lacoloco.pipelines.sim.tasks import load_task_file
from lacoloco.robots.loading import load_folder
from lacoloco.robots.registry import load_robot
from lacoloco_cli.failures import USER_MISTAKE, explain
from lacoloco_cli.overrides import apply_overrides, field_paths, restored
from lacoloco_cli.stage_settings import stage_settings

CHECKOUT = Path(__file__).parents[1]
SECONDS = 10.0
"""For one input, on a busy machine."""
MEMORY = 2 << 30
"""Bytes that one process may have beyond those it starts with."""


class HangError(BaseException):
    """An input took too long; no reader catches this."""


class Reader:
    """One reader, its sound inputs, and how they are altered."""

    def __init__(self, folder: Path) -> None:
        """Prepare sound inputs in a folder of its own."""
        self.folder = folder

    def try_one(self, chance: random.Random) -> None:
        """Read one altered input."""
        raise NotImplementedError


class Texts(Reader):
    """A reader of text files."""

    def __init__(self, folder: Path, name: str, sound: list[bytes], read: Callable) -> None:
        """Take sound texts, the name of the file, and what reads it."""
        super().__init__(folder)
        self.file, self.sound, self.read = folder / name, sound, read

    def try_one(self, chance: random.Random) -> None:
        """Write an altered text and read it."""
        self.file.write_bytes(mutated_text(chance.choice(self.sound), chance))
        self.read(self.file)


def short_dog() -> bytes:
    """The sample with three frames."""
    text = (CHECKOUT / "datasets/samples/dog_walk_trot_turn.bvh").read_text()
    lines = text.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("Frames:"))
    lines[first] = "Frames: 3"
    return "\n".join(lines[: first + 5]).encode() + b"\n"


def bvh(folder: Path) -> Reader:
    """Motion capture."""
    return Texts(folder, "walk.bvh", [short_dog()], load_bvh)


def body_map(folder: Path) -> Reader:
    """Maps from joints to the robot."""
    maps = (CHECKOUT / "pipelines/retargeting/mocap/maps").glob("*.toml")
    return Texts(folder, "map.toml", [path.read_bytes() for path in sorted(maps)], load_map)


def selection(folder: Path) -> Reader:
    """Selections of recordings."""
    files = (CHECKOUT / "pipelines/retargeting/mocap/selections").glob("*.toml")
    sound = [path.read_bytes() for path in sorted(files)]
    return Texts(folder, "chosen.toml", sound, lambda path: load_selection(str(path)))


def robot(folder: Path) -> Reader:
    """A robot's numbers."""
    source = CHECKOUT / "robots/solo12"
    (folder / "solo12").mkdir()
    (folder / "solo12/solo12.xml").write_bytes((source / "solo12.xml").read_bytes())
    sound = [(source / "robot.toml").read_bytes()]
    return Texts(folder / "solo12", "robot.toml", sound, lambda path: load_folder(path.parent))


def task(folder: Path) -> Reader:
    """Tasks of one's own."""
    spec = load_robot("solo12")
    files = sorted((CHECKOUT / "robots/solo12/tasks").glob("*.toml"))
    sound = [path.read_bytes() for path in files]
    return Texts(folder, "task.toml", sound, lambda path: load_task_file(spec, path))


class ForeignMotions(Reader):
    """Readers of other programs' motions: of altered bytes, and of altered contents."""

    def __init__(self, folder: Path) -> None:
        """Make a sound motion of five frames in every format."""
        super().__init__(folder)
        frames, joints = 5, 12
        pos, pose = np.zeros((frames, 3)), np.zeros((frames, joints))
        quat = np.tile([0.0, 0.0, 0.0, 1.0], (frames, 1))
        rows = np.hstack([pos, quat, pose]).tolist()
        self.frames = {"LoopMode": "Wrap", "FrameDuration": 0.02, "Frames": rows}
        self.pickled = [
            {"fps": 30, "root_pos": pos.tolist(), "root_rot": quat.tolist(), "dof_pos": rows},
            {"fps": 30, "loop_mode": 0, "frames": rows},
        ]
        bodies = {"body_pos_w": pos[:, None], "body_quat_w": quat[:, None]}
        self.arrays = {"fps": np.array([50]), "joint_pos": pose, **bodies}
        table = "\n".join(",".join(map(str, row)) for row in rows)
        names = [f"root_{name}" for name in ("x", "y", "z", "qx", "qy", "qz", "qw")]
        header = ",".join([*names, *(f"joint_{index}" for index in range(joints))])
        arrays = {"fps": 30, "root_pos": pos, "root_rot": quat, "dof_pos": pose}
        self.sound = [
            (".csv", table.encode()),
            (".csv", f"{header}\n{table}".encode()),
            (".json", json.dumps(self.frames).encode()),
            (".npz", npz_bytes(self.arrays)),
            (".pkl", pickle.dumps(arrays)),
            (".pkl", pickle.dumps(self.pickled[1], 0)),
        ]

    def try_one(self, chance: random.Random) -> None:
        """Alter the bytes of a file, or what it holds."""
        if chance.random() < 0.5:
            ending, sound = chance.choice(self.sound)
            content = mutated_text(sound, chance)
        else:
            ending, content = self._altered(chance)
        file = self.folder / f"motion{ending}"
        file.write_bytes(content)
        read_motion(file)

    def _altered(self, chance: random.Random) -> tuple[str, bytes]:
        kind = chance.randrange(3)
        if kind == 0:
            return ".npz", npz_bytes(altered_arrays(self.arrays, chance))
        if kind == 1:
            return ".txt", json.dumps(mutated_json(self.frames, chance)).encode()
        value = mutated_json(chance.choice(self.pickled), chance)
        return ".pickle", pickle.dumps(value, chance.randrange(pickle.HIGHEST_PROTOCOL + 1))


class Artifacts(Reader):
    """Readers of artifacts: of altered bytes, and of altered tables with a hash that fits."""

    def __init__(self, folder: Path) -> None:
        """Make a small set of clips; the small policies are the published ones."""
        super().__init__(folder)
        from lacoloco.datasets.artifact import read_artifact
        from lacoloco.datasets.clip import Clip, save_clips

        frames, names = 5, ("a", "b")
        quat = np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1))
        series = (np.zeros((frames, 3)), quat, np.zeros((frames, 2)))
        clips = [Clip.from_poses(name, 50.0, names, *series) for name in ("one", "two")]
        path = save_clips(folder / "clips.h5", clips, robot=("solo12", "abc"), config={"a": 1})
        self.bytes, self.clips = path.read_bytes(), read_artifact(path)
        self.policy = self._small_policy()
        self.file = folder / "altered.h5"

    def _small_policy(self):
        from lacoloco.datasets.artifact import read_artifact
        from lacoloco.datasets.store import RunStore
        from lacoloco.pipelines.learn.networks import NetworkConfig, make_actor
        from lacoloco.pipelines.policies import Head, Policy, save_policies
        from lacoloco.pipelines.stage import StageContext

        networks = NetworkConfig(actor=(4,), critic=(4,))
        sizes = {"policy": 6, "latent": 3}
        actor = make_actor(sizes, 4, networks).eval()
        path = save_policies(
            self.folder / "policy.h5",
            [Policy(Head("low", sizes, 4, networks, [], "imitate"), actor)],
            spec=load_robot("solo12"),
            context=StageContext(RunStore(self.folder), "run"),
            config={},
            parents=[],
            metrics={},
        )
        return read_artifact(path)

    def try_one(self, chance: random.Random) -> None:
        """Alter bytes, or the tables of clips, or those of a policy."""
        kind = chance.randrange(3)
        self.file.unlink(missing_ok=True)
        if kind == 0:
            self.file.write_bytes(mutated_text(self.bytes, chance))
            lineage(self.file)
            load_clips(self.file)
            return
        sound = self.clips if kind == 1 else self.policy
        arrays = dict(sound.arrays)
        if chance.random() < 0.3:
            arrays = altered_arrays(arrays, chance)
        metadata = mutated_json(sound.metadata, chance)
        if not isinstance(metadata, dict):
            metadata = {}
        write_artifact(
            self.file, sound.schema, arrays, metadata=metadata, config={}, seed=0, robot=None
        )
        (load_clips if kind == 1 else load_policies)(self.file)


class Settings(Reader):
    """`--set`, settings of an experiment, and stored configs."""

    def __init__(self, folder: Path) -> None:
        """Take the configs of the two trainings."""
        super().__init__(folder)
        self.configs = [train_low.PRESETS["smoke"](), train_high.PRESETS["smoke"]()]
        self.names = list(EXPERIMENTS)

    def try_one(self, chance: random.Random) -> None:
        """Set one to three keys to something."""
        kind, config = chance.randrange(4), chance.choice(self.configs)
        if kind == 0:
            restored(config, mutated_json(dataclasses.asdict(config), chance))
            return
        keys = list(field_paths(config))
        given = []
        for _ in range(chance.randint(1, 3)):
            value = chance.choice((*NASTY, "0.5", "64,64", "(a,1),(b,2)", "7", "1e6"))
            given.append(f"{chance.choice(keys)}={value}")
            if chance.random() < 0.3:
                given[-1] = mutated_text(given[-1].encode(), chance).decode("utf-8", "replace")
        if kind == 1:
            stage = "train-low" if config is self.configs[0] else "train-high"
            name = chance.choice(self.names)
            stage_settings([f"{stage}.{one}" for one in given], EXPERIMENTS[name], "smoke")
        else:
            apply_overrides(config, given)


READERS: dict[str, Callable[[Path], Reader]] = {
    "bvh": bvh,
    "body-map": body_map,
    "selection": selection,
    "robot": robot,
    "task": task,
    "artifact": Artifacts,
    "foreign-motion": ForeignMotions,
    "settings": Settings,
}


def _too_long(*_: object) -> None:
    raise HangError


def fuzz(name: str, count: int, seed: int, folder: Path) -> tuple[dict[str, int], dict[str, str]]:
    """Try so many inputs of a reader.

    Returns:
        How often each outcome came, and what should not have come: where -> the first input's
        number with its traceback.
    """
    reader = READERS[name](folder)
    outcomes: dict[str, int] = collections.Counter()
    found: dict[str, str] = {}
    before = signal.signal(signal.SIGALRM, _too_long)
    limits = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, limits[1]))
    try:
        for index in range(count):
            chance = random.Random(f"{name} {seed} {index}")
            signal.setitimer(signal.ITIMER_REAL, SECONDS)
            try:
                reader.try_one(chance)
                outcome = "read"
            except (Exception, HangError) as error:
                signal.setitimer(signal.ITIMER_REAL, 0)
                outcome = "refused"
                if isinstance(error, HangError) or explain(error)[1] != USER_MISTAKE:
                    outcome = type(error).__name__
                    last = traceback.extract_tb(error.__traceback__)[-1]
                    where = f"{name}: {outcome} in {Path(last.filename).name}:{last.lineno}"
                    found.setdefault(where, f"input {index}\n{traceback.format_exc(limit=-5)}")
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0)
            outcomes[outcome] += 1
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)
        signal.signal(signal.SIGALRM, before)
    return outcomes, found


@pytest.mark.skipif(sys.platform != "linux", reason="the limit on memory is read from /proc")
@pytest.mark.parametrize("name", READERS)
def test_no_input_ends_in_a_traceback_a_hang_or_without_memory(name, tmp_path):
    outcomes, found = fuzz(name, 60, 0, tmp_path)
    assert found == {}
    assert outcomes["refused"] > 5
    assert sum(outcomes.values()) == 60


def main(count: int, seed: int) -> int:
    """Try so many inputs, the readers in turns; print the counts and what was found."""
    shares = dict.fromkeys(READERS, count // len(READERS))
    shares["settings"] += count - sum(shares.values())
    failed = 0
    for name, share in shares.items():
        begin = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            outcomes, found = fuzz(name, share, seed, Path(folder))
        told = ", ".join(f"{key} {value:,}" for key, value in sorted(outcomes.items()))
        print(f"{name}: {told}; {time.monotonic() - begin:.0f} s", flush=True)  # noqa: T201
        for where, what in found.items():
            failed += 1
            print(f"{where}\n{what}", flush=True)  # noqa: T201
    return 1 if failed else 0


if __name__ == "__main__":
    arguments = [int(argument) for argument in sys.argv[1:]]
    sys.exit(main(*(arguments + [100_000, 0][len(arguments) :])))
