"""The log of a training: ``metrics.jsonl`` and TensorBoard events."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

from lacoloco.datasets.atomic_write import write_file
from lacoloco.pipelines.training.diagnostics import Metrics


class MetricsLog:
    """``metrics.jsonl`` and TensorBoard events of one training, appended to when it resumes."""

    def __init__(self, directory: Path, name: str, done: int = 0) -> None:
        """Open both in ``directory``; ``name`` prefixes the TensorBoard tags.

        Lines of this training beyond ``done`` samples are dropped: a killed one wrote them after
        its last checkpoint.
        """
        from torch.utils.tensorboard import SummaryWriter

        self.name = name
        path = directory / "metrics.jsonl"
        lines = path.read_text().splitlines(keepends=True) if path.exists() else []
        kept = [line for line in lines if not self._is_repeated(line, done)]
        if kept != lines:  # in one step: the lines of before are never half there
            write_file(path, "".join(kept).encode(), replace=True)
        self.history: list[Metrics] = [
            one for one in map(json.loads, kept) if one["training"] == name
        ]
        """The metrics of all iterations of this training so far, also of those before it was
        resumed.
        """
        self._lines = path.open("a")
        self._events = SummaryWriter(str(directory / "tensorboard"), purge_step=done + 1)

    def _is_repeated(self, line: str, done: int) -> bool:
        try:
            logged = json.loads(line)
        except json.JSONDecodeError:  # cut short by the kill
            return True
        return logged["training"] == self.name and logged["samples"] > done

    def __enter__(self) -> MetricsLog:
        """Use as a context manager."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close both."""
        self._lines.close()
        self._events.close()

    def write(self, samples: int, metrics: dict[str, float]) -> None:
        """Log one iteration's metrics at ``samples`` control steps."""
        self.history.append({"training": self.name, "samples": samples, **metrics})
        self._lines.write(json.dumps(self.history[-1]) + "\n")
        self._lines.flush()
        for name, value in metrics.items():
            self._events.add_scalar(f"{self.name}/{name}", value, samples)


class NoLog(nullcontext):
    """The log of the processes that write none."""

    history: Sequence[Metrics] = ()

    def write(self, samples: int, metrics: dict[str, float]) -> None:
        """Nothing."""
