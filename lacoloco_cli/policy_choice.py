"""Which trained policies a verb takes from a run, and how `--train-missing` makes others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from lacoloco_cli.overrides import restored
from lacoloco_cli.session import Session

if TYPE_CHECKING:
    from lacoloco.datasets.artifact import Header


@dataclass(frozen=True)
class Trained:
    """One policy of a run."""

    method: str
    seed: int
    header: Header


def trained(session: Session, stage: str) -> list[Trained]:
    """The run's policies of one stage, the newest of each method and seed, by method and seed."""
    from lacoloco.datasets.artifact import read_header

    newest: dict[tuple[str, int], Trained] = {}
    for path in session.store.all(session.run_name, stage):
        header = read_header(path)
        method, seed = header.metadata["method"], header.seed or 0
        newest[method, seed] = Trained(method, seed, header)
    return [newest[key] for key in sorted(newest)]


def missing(found: Sequence[Trained], seeds: Sequence[int]) -> list[tuple[str, int]]:
    """Method and seed of every policy that was asked for and is not there."""
    there = {(policy.method, policy.seed) for policy in found}
    methods = dict.fromkeys(policy.method for policy in found)
    return [(m, seed) for m in methods for seed in seeds if (m, seed) not in there]


def best(session: Session) -> Path:
    """The policy that the run's newest evaluation chose; the newest if that was not among them.

    Clocks go back, so times are not compared: an evaluation names the policies that it saw.

    Raises:
        ArtifactError: The run has no high-level policy, or the evaluation does not fit.
    """
    from lacoloco.datasets.artifact import read_header
    from lacoloco.datasets.errors import ArtifactError

    newest = session.store.newest(session.run_name, "train-high")
    for path in session.store.all(session.run_name, "eval")[-1:]:
        evaluation = read_header(path)
        seen = [parent.locate(path) for parent in evaluation.parents]
        rows, chosen = evaluation.metadata["rows"], evaluation.metadata["best"]
        if chosen not in rows or len(rows) != len(seen):
            raise ArtifactError(f"{path}: its rows are not those of its policies; evaluate again")
        policy = seen[rows.index(chosen)]
        if policy.is_file() and newest.resolve() in (one.resolve() for one in seen):
            return policy
    return newest


def train_missing(session: Session, method: str, seed: int) -> Path:
    """Train a seed the way the method's other seeds were trained, both levels.

    Returns:
        The high level's artifact.
    """
    from lacoloco.pipelines import train_high, train_low
    from lacoloco.pipelines.low_level.config import TrainLowConfig

    context = replace(session.context(), seed=seed, resume=False)
    high = [policy for policy in trained(session, "train-high") if policy.method == method][-1]
    lows = [policy for policy in trained(session, "train-low") if policy.method == method]
    same_seed = [policy.header.path for policy in lows if policy.seed == seed]
    if same_seed:
        low = same_seed[0]
    else:
        example = lows[-1].header if lows else _low_of(high.header)
        low_config = restored(TrainLowConfig(), example.config, str(example.path))
        motions = [parent.locate(example.path) for parent in example.parents]
        low = train_low.run(low_config, context, motions=motions).artifact
    high_config = restored(train_high.TrainHighConfig(), high.header.config, str(high.header.path))
    return train_high.run(high_config, context, low=low).artifact


def _low_of(high: Header) -> Header:
    from lacoloco.datasets.artifact import read_header

    return read_header(high.parents[0].locate(high.path))
