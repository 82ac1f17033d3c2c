"""Checkpoints of a training."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from lacoloco.datasets.artifact import read_artifact, read_header, write_artifact
from lacoloco.datasets.beside import CHECKPOINT as ENDING
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.state import flatten_state, unflatten_state
from lacoloco.pipelines.learn import parallel
from lacoloco.pipelines.stage import StageContext
from lacoloco.pipelines.training.trainer import Stateful

CHECKPOINT = "lacoloco/checkpoint"
LAYOUT = 2
"""Of a trainer's state: counts up when its parts are renamed."""
TRAINING, PRETRAINING = "training", "pretraining"
"""What a checkpoint is of. A training's first one replaces that of its pretraining."""
INDIVIDUAL = ("env", "latent", "latents", "restarts", "exploring", "generator")
"""Parts of a trainer's state that every process of a training has for itself: its worlds and its
generators.
"""
OLD_PARTS = {"draw": "generator"}
"""Names that parts of a trainer's state had in earlier versions -> today's."""


def checkpoint_path(directory: Path, description: str) -> Path:
    """Where a training's checkpoint lies in its stage's directory."""
    return directory / f"{description.replace(' ', '-')}{ENDING}"


def part_of(path: Path) -> str:
    """What a checkpoint is of, ``TRAINING`` or ``PRETRAINING``; empty where there is none.

    Raises:
        ArtifactError: It is damaged.
    """
    return _part(read_header(path).metadata) if path.exists() else ""


def _part(metadata: Mapping[str, Any]) -> str:
    return str(metadata.get("part", TRAINING))


def save_checkpoint(
    trainer: Stateful,
    path: Path,
    iteration: int,
    elapsed: float,
    metrics: dict[str, float],
    context: StageContext,
    config: dict[str, Any],
    part: str = TRAINING,
) -> None:
    """Write a checkpoint of a part of the work; it replaces the one before."""
    state = {
        "trainer": trainer.state_dict(),
        "torch_rng": torch.get_rng_state(),
        "metrics": metrics,
    }
    if context.device.startswith("cuda"):
        state["cuda_rng"] = torch.cuda.get_rng_state()
    arrays, structure = flatten_state(state)
    metadata = {
        "layout": LAYOUT,
        "part": part,
        "structure": structure,
        "iteration": iteration,
        "elapsed_s": elapsed,
        "processes": parallel.size(),
    }
    write_artifact(
        path,
        CHECKPOINT,
        arrays,
        metadata=metadata,
        config=config,
        seed=context.seed,
        robot=None,
        command=context.command,
        replace=True,
    )


def restore_checkpoint(
    trainer: Stateful, path: Path, seed: int, part: str = TRAINING
) -> tuple[int, float, dict[str, float]]:
    """Continue from a checkpoint, if there is one of this part of the work.

    Returns:
        Iterations done, seconds they took, metrics of the last one.

    Raises:
        ArtifactError: The checkpoint is damaged, or of another version.
    """
    if not path.exists():
        return 0, 0.0, {}
    artifact = read_artifact(path, CHECKPOINT)
    if artifact.metadata.get("layout") != LAYOUT:
        raise ArtifactError(
            f"{path}: a checkpoint of another version of lacoloco; finish it with that version, or "
            "start the training again"
        )
    if _part(artifact.metadata) != part:
        return 0, 0.0, {}
    iteration, elapsed = artifact.metadata["iteration"], float(artifact.metadata["elapsed_s"])
    state = unflatten_state(artifact.arrays, artifact.metadata["structure"])
    try:
        _restore(trainer, state, artifact.metadata.get("processes", 1), iteration, seed)
        return iteration, elapsed, dict(state["metrics"])
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, RuntimeError) as error:
        told = " ".join(str(error).split())[:200]
        raise ArtifactError(
            f"{path}: is not of this training ({type(error).__name__}: {told}); start it again"
        ) from error


def _restore(
    trainer: Stateful, state: dict[str, Any], processes: int, iteration: int, seed: int
) -> None:
    """Put the state of a checkpoint into the trainer and the generators."""
    state["trainer"] = _under_todays_names(state["trainer"])
    if parallel.rank() == 0 and processes == parallel.size():
        trainer.load_state_dict(state["trainer"])
        torch.set_rng_state(state["torch_rng"])
        if "cuda_rng" in state and torch.cuda.is_available():
            torch.cuda.set_rng_state(state["cuda_rng"])
    else:
        # The file holds the first process's worlds: the others go on with new ones, or they would
        # do the same again. So does the first one when there are more or fewer processes now, and
        # its share is another.
        trainer.load_state_dict(_with_own(state["trainer"], trainer.state_dict()))
        torch.manual_seed(parallel.own_seed(seed) + iteration)


def _under_todays_names(state: dict[str, Any]) -> dict[str, Any]:
    """``state`` with the parts of :data:`OLD_PARTS` renamed, at every depth."""
    return {
        OLD_PARTS.get(name, name): _under_todays_names(value) if isinstance(value, dict) else value
        for name, value in state.items()
    }


def _with_own(loaded: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    """``loaded`` with what is individual taken from ``own``, at every depth."""
    merged = dict(loaded)
    for name, value in loaded.items():
        if name in INDIVIDUAL:
            merged[name] = own[name]
        elif isinstance(value, dict) and isinstance(own.get(name), dict):
            merged[name] = _with_own(value, own[name])
    return merged
