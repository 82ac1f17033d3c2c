"""Clips that were made before and need not be made again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lacoloco.datasets.artifact import read_artifact, read_header
from lacoloco.datasets.beside import FINISHED_CLIPS, FINISHED_CLIPS_BEFORE
from lacoloco.datasets.clip import SCHEMA, Clip, clips_of
from lacoloco.datasets.errors import ArtifactError
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines.retargeting.worker import picture_path


@dataclass(frozen=True)
class FinishedClip:
    """One clip as it was written, with its metrics and, where there is one, its picture."""

    clip: Clip
    metrics: dict[str, Any]
    picture: Path | None

    @property
    def key(self) -> str:
        """See `Worker.key`."""
        return self.metrics["key"]


def earlier_clips(candidates: Iterable[Path], keys: Set[str]) -> dict[str, FinishedClip]:
    """Clips with these keys in some artifacts, of which those that come first count."""
    found: dict[str, FinishedClip] = {}
    for path in candidates:
        try:
            if keys & set(clip_keys(path)) - set(found):
                found |= {p.key: p for p in finished_clips(path) if p.key in keys - set(found)}
        except (ArtifactError, KeyError, TypeError):
            continue  # damaged, or by another lacoloco: made again
    return found


def clip_keys(path: Path) -> list[str]:
    """Keys of the clips in an artifact; empty where they have none.

    Raises:
        ArtifactError: It cannot be read.
    """
    rows = read_header(path).metadata.get("metrics", {}).get("clips", [])
    return [row.get("key", "") for row in rows]


def finished_clips(path: Path) -> Iterator[FinishedClip]:
    """The clips of an artifact, read and verified.

    Raises:
        ArtifactError: It is damaged.
    """
    artifact = read_artifact(path, SCHEMA)
    rows = artifact.metadata["metrics"]["clips"]
    for clip, metrics in zip(clips_of(artifact), rows, strict=True):
        unfinished = path.parent.name in (FINISHED_CLIPS, FINISHED_CLIPS_BEFORE)
        folder = path.parent.parent if unfinished else path.parent
        pictures = [picture_path(folder, clip.name)]
        if len(rows) == 1:
            pictures.append(folder / "report.png")
        picture = next((picture for picture in pictures if picture.is_file()), None)
        yield FinishedClip(clip, metrics, picture)


def own_clips(folder: Path) -> list[Path]:
    """The clips that an unfinished version has finished so far."""
    names = (FINISHED_CLIPS, FINISHED_CLIPS_BEFORE)
    return [path for name in names for path in sorted((folder / name).glob("*.h5"))]


def known_clips(store: RunStore, run: str, stage: str) -> list[Path]:
    """Clips that killed ones left of a stage, and its complete versions, newest first."""
    left = [path for one in reversed(store.partials(run, stage)) for path in own_clips(one.path)]
    return left + list(reversed(store.all(run, stage)))
