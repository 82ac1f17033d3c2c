"""How long a large library of motions takes to load, and how much memory: in a process of its own.

python -m lacoloco.pipelines.benchmarks.motion_loading FILE
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from lacoloco.datasets.clip import load_clips, save_clips
from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.benchmarks.throughput import made_up_clips
from lacoloco.pipelines.errors import StageError
from lacoloco.robots.registry import load_robot

CLIP_S = 10.0
DISTINCT = 32
"""Clips that are made; the others repeat them under other names."""
BATCH = 4096
"""Transitions that are drawn at a time."""


def bench_motions(robot: str, hours: float) -> dict[str, Any]:
    """Write made-up motions that a robot performed, load them, and draw from them.

    Args:
        robot: name or folder.
        hours: of motion, in clips of 10 s at 50 Hz.

    Returns:
        `clips`; `bytes` of their file; of reading and checking it (`load`) and of what is computed
        for sampling (`build`) the seconds and `cpu_s`; `peak_bytes` of memory that both took, None
        where the system does not say, and `peak_ratio` to the file; `transitions_ms` of processor
        time for 4096 transitions.

    Raises:
        StageError: less than one clip.
    """
    count = round(hours * 3600 / CLIP_S)
    if count < 1:
        raise StageError(f"--hours {hours:g}: is less than one clip of {CLIP_S:g} s")
    spec = load_robot(robot)
    made = [
        replace(clip, joint_target=clip.joint_pos)
        for clip in made_up_clips(spec, min(count, DISTINCT), seconds=CLIP_S)
    ]
    clips = [replace(made[index % len(made)], name=f"clip_{index}") for index in range(count)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "motions.h5"
        save_clips(path, clips, robot=(spec.name, spec.model_hash()), config={})
        child = subprocess.run(
            [sys.executable, "-m", __spec__.name, str(path)], capture_output=True, text=True
        )
        if child.returncode:
            raise StageError(f"loading failed: {child.stderr.strip().splitlines()[-1]}")
        measured = json.loads(child.stdout)
        size = path.stat().st_size
    peak = measured["peak_bytes"]
    ratio = None if peak is None else peak / size
    return {"clips": count, "bytes": size, **measured, "peak_ratio": ratio}


def measure(path: Path) -> dict[str, Any]:
    """Load the motions of a file, and draw from them, once."""
    before = _memory("VmRSS")
    start, cpu = time.perf_counter(), time.process_time()
    clips = load_clips(path)
    loaded, loaded_cpu = time.perf_counter(), time.process_time()
    library = MotionLibrary(clips)
    built, built_cpu = time.perf_counter(), time.process_time()
    peak = _memory("VmHWM")
    return {
        "load_s": loaded - start,
        "load_cpu_s": loaded_cpu - cpu,
        "build_s": built - loaded,
        "build_cpu_s": built_cpu - loaded_cpu,
        "peak_bytes": None if peak is None or before is None else peak - before,
        "transitions_ms": _transitions_ms(library),
    }


def _transitions_ms(library: MotionLibrary, rounds: int = 20) -> float:
    torch.set_num_threads(1)
    library.sample_transitions(BATCH, 0.02)
    times = []
    for _ in range(rounds):
        start = time.process_time()
        library.sample_transitions(BATCH, 0.02)
        times.append(1000 * (time.process_time() - start))
    return float(np.median(times))


def _memory(kind: str) -> int | None:
    """Bytes of memory of this process: "VmRSS" now, "VmHWM" at most so far; None but on Linux."""
    status = Path("/proc/self/status")
    if not status.is_file():
        return None
    lines = dict(line.split(":", 1) for line in status.read_text().splitlines())
    return int(lines[kind].split()[0]) * 1024


if __name__ == "__main__":
    sys.stdout.write(json.dumps(measure(Path(sys.argv[1]))) + "\n")
