"""Run directories: runs/<run>/<stage>/<version>/artifact.h5, each version complete or hidden.

A stage works in the hidden directory `.<version>[-<label>].partial`, which takes its final name in
one step when the artifact is there. What a killed stage leaves is only ever a partial directory;
it can be resumed, and no reader sees it.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import FileIO
from pathlib import Path

from lacoloco.datasets import locks
from lacoloco.datasets.atomic_write import abandoned, remove_leftovers, sync_directory, write_file
from lacoloco.datasets.beside import ARTIFACT, LOCK, PARTIAL, working_files
from lacoloco.datasets.errors import ArtifactError, storage_errors
from lacoloco.datasets.roots import NUMBERING, nearest_root
from lacoloco.datasets.work import Work, in_one_line

_NAME = re.compile(r"[A-Za-z0-9][\w.+-]{0,99}")
_COMPLETE = re.compile(r"(\d{4,})")
_PARTIAL = re.compile(rf"\.(\d{{4,}})(?:-(.+))?\{PARTIAL}")
_LAST = ".last"
_BEGINNING = ".beginning"
_REMOVED = ".removed"
"""Endings of a directory that is not a partial one yet, and of one that is none any more."""


@dataclass
class StageDir:
    """The working directory of one version of a stage, until `complete` gives it its name."""

    path: Path
    """The partial directory: checkpoints, metrics, events and the artifact go here."""
    final: Path
    """The directory it becomes."""
    label: str
    """What tells versions of one stage apart while they are worked on, e.g. method and seed."""
    _lock: FileIO | None = None

    def file(self, name: str) -> Path:
        """Path of a file in the partial directory."""
        return self.path / name

    def complete(self) -> Path:
        """Give the directory its final name in one step; nothing made in it changes from then on.

        What the work went on from (checkpoints, finished clips) goes once the version is complete.

        Returns:
            Path of the artifact in its final place.

        Raises:
            ArtifactError: the file system refuses; the partial directory stays as it is.
            RuntimeError: the stage has not written its artifact.
        """
        if not self.file(ARTIFACT).is_file():
            raise RuntimeError(f"{self.path}: completed without an {ARTIFACT}")
        with storage_errors(self.final, "complete the stage"):
            if self.final.exists():  # POSIX would replace an empty directory without a word
                raise ArtifactError(f"{self.final}: exists already; move it away and --resume")
            remove_leftovers(self.path)
            sync_directory(self.path)
            with _turn(self.final.parents[2]):  # nobody looks at the partial directory meanwhile
                self.path.rename(self.final)
                self.path = self.final
                remove_working(self.final)
            sync_directory(self.final.parent)
        self._release()
        return self.file(ARTIFACT)

    def discard(self) -> None:
        """Delete the partial directory and all that is in it.

        Raises:
            ArtifactError: the stage is complete, or the file system refuses.
        """
        if self.path == self.final:
            raise ArtifactError(f"{self.final}: is complete and stays")
        with storage_errors(self.path, "delete"):
            # Under another name nobody resumes what is half deleted.
            removed = self.path.with_suffix(_REMOVED)
            with _turn(self.final.parents[2]):
                self.path.rename(removed)
            with suppress(FileNotFoundError):  # `clean` of another process was quicker
                shutil.rmtree(removed)
        self._release()

    def held(self) -> bool:
        """Whether another process works in the directory."""
        lock = locks.take(self.file(LOCK))
        if lock is not None:
            lock.close()
        return lock is None

    def _claim(self) -> bool:
        """Take the directory for this process; False while another process works in it."""
        self._lock = locks.take(self.file(LOCK))
        if self._lock is None:
            return False
        remove_leftovers(self.path)
        return True

    def _reopen(self) -> None:
        """Take away the artifact of a stage that was killed after it; its last step is repeated."""
        self.file(ARTIFACT).unlink(missing_ok=True)

    def _release(self) -> None:
        if self._lock is not None:
            self._lock.close()
            self._lock = None


class RunStore:
    """All runs below one directory."""

    def __init__(self, root: Path | None = None) -> None:
        """Name the directory; nothing is made or read yet.

        Args:
            root: the runs directory; default `$LACOLOCO_RUNS`, else the nearest `runs` with runs in
                the working directory or above it, else `runs` in the working directory.
        """
        self.root = Path(root or os.environ.get("LACOLOCO_RUNS") or nearest_root())

    def last_run(self) -> str | None:
        """Name of the run used last, None in a fresh directory."""
        try:
            name = (self.root / _LAST).read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError):
            return None
        return name if _NAME.fullmatch(name) else None

    def use(self, run: str) -> None:
        """Remember `run` as the one used last.

        Raises:
            ArtifactError: the name cannot be a directory name, or the file system refuses.
        """
        self.directory(run)
        write_file(self.root / _LAST, f"{run}\n".encode(), replace=True)

    def directory(self, run: str, stage: str = "") -> Path:
        """Directory of a run, or of a stage in it, existing or not.

        Raises:
            ArtifactError: a name that cannot be a directory name.
        """
        for what, name in (("run", run), ("stage", stage or "x")):
            if not _NAME.fullmatch(name):
                raise ArtifactError(
                    f"{what} '{name}': use letters, digits, '-', '_', '+', '.', a letter or digit"
                    " first, at most 100"
                )
        return self.root / run / stage

    def runs(self) -> list[str]:
        """Names of all runs, sorted.

        Raises:
            ArtifactError: the directory cannot be read.
        """
        return [p.name for p in _list(self.root) if p.is_dir() and _NAME.fullmatch(p.name)]

    def stages(self, run: str) -> list[str]:
        """Stages of a run that have been begun at least once, sorted."""
        directory = self.directory(run)
        return [p.name for p in _list(directory) if p.is_dir() and _NAME.fullmatch(p.name)]

    def all(self, run: str, stage: str) -> list[Path]:
        """Artifacts of all complete versions of a stage, oldest first."""
        versions = [p for p in _list(self.directory(run, stage)) if _COMPLETE.fullmatch(p.name)]
        versions.sort(key=lambda p: int(p.name))
        return [p / ARTIFACT for p in versions if (p / ARTIFACT).is_file()]

    def newest(self, run: str, stage: str) -> Path:
        """Artifact of the newest complete version of a stage.

        Raises:
            ArtifactError: there is none; the message names the verb that makes it.
        """
        complete = self.all(run, stage)
        if complete:
            return complete[-1]
        command = f"lacoloco {stage} --run {run}"
        if self.partials(run, stage):
            hint = f"an unfinished one is there; continue it with `{command} --resume`"
        elif (self.root / run).is_dir():
            hint = f"make it with `{command}`"
        else:
            known = ", ".join(self.runs()) or "none yet"
            hint = f"make it with `{command}`, or name another run with --run (known: {known})"
        raise ArtifactError(f"run '{run}' has no {stage} artifact in {self.root}: {hint}")

    def partials(self, run: str, stage: str, label: str = "") -> list[StageDir]:
        """Unfinished versions of a stage, oldest first; with a label only those that carry it."""
        found = []
        for path in _list(self.directory(run, stage)):
            match = _PARTIAL.fullmatch(path.name)
            if match and path.is_dir() and label in ("", match[2]):
                found.append(StageDir(path, path.with_name(match[1]), match[2] or ""))
        return sorted(found, key=lambda stage_dir: int(stage_dir.final.name))

    def leftovers(self, run: str) -> list[Path]:
        """What killed stages left of a run: unfinished versions, and what should have gone.

        Versions that another process works on are not among them.
        """
        found = abandoned(self.root) + abandoned(self.directory(run))
        for stage in self.stages(run):
            found += [one.path for one in self.partials(run, stage) if not one.held()]
            for path in _list(self.directory(run, stage)):
                hidden = path.is_dir() and path.name.startswith(".")
                if hidden and path.suffix in (_BEGINNING, _REMOVED):
                    found.append(path)
            for artifact in self.all(run, stage):
                found += working_files(artifact.parent)
        return found

    def clean(self, path: Path) -> bool:
        """Delete one of `leftovers`; False where another process took it meanwhile.

        Raises:
            ArtifactError: the file system refuses.
        """
        match = _PARTIAL.fullmatch(path.name)
        if match:
            stage_dir = StageDir(path, path.with_name(match[1]), match[2] or "")
            with storage_errors(path, "delete"):
                if not path.is_dir() or not stage_dir._claim():
                    return False
            stage_dir.discard()
            return True
        with storage_errors(path, "delete"), _turn(self.root):  # nobody begins meanwhile
            if not path.exists():
                return False
            _delete(path)
        return True

    def begin(
        self,
        run: str,
        stage: str,
        *,
        work: Work | None = None,
        label: str = "",
        resume: bool = False,
        version: str = "",
        or_begin: bool = False,
        at_once: bool = False,
    ) -> StageDir:
        """Open a working directory for a stage.

        Args:
            run: name of the run, made when it is new.
            stage: name of the stage, that is, of its verb.
            work: what the version is made from; kept with it, and compared by `resume`.
            label: marks the version while it is unfinished; with `resume`, the one to continue
                ("" takes any).
            resume: continue the newest unfinished version with this work instead of beginning one.
            version: with `resume`, the only version to continue, e.g. "0003".
            or_begin: with `resume`, begin one where none has this work.
            at_once: the stage has nothing to go on with; what killed ones left of it is deleted.

        Raises:
            ArtifactError: nothing to resume, or only other work (the message tells the difference),
                another process is at work on it, or the file system refuses.
        """
        if label and not _NAME.fullmatch(label):
            raise ArtifactError(f"label '{label}': use letters, digits, '-', '_', '+', '.'")
        if resume and not or_begin and not self.partials(run, stage):
            raise self._nothing(run, stage, label, version)  # and no folder is made
        with storage_errors(self.directory(run, stage), "create the run directory"):
            self.directory(run, stage).mkdir(parents=True, exist_ok=True)
            with _turn(self.root):
                if resume:
                    found = self._resumed(run, stage, label, work, version, or_begin)
                    if found is not None:
                        return found
                begun = self._begun(run, stage, label, work)

            for left in self.partials(run, stage) if at_once else []:
                if left.path != begun.path and left._claim():
                    left.discard()
            return begun

    def _begun(self, run: str, stage: str, label: str, work: Work | None) -> StageDir:
        directory = self.directory(run, stage)
        taken = [0, *(int(s.final.name) for s in self.partials(run, stage))]
        taken += [int(p.name) for p in _list(directory) if _COMPLETE.fullmatch(p.name)]
        final = directory / f"{max(taken) + 1:04d}"
        stage_dir = StageDir(
            directory / f".{final.name}{f'-{label}' if label else ''}{PARTIAL}", final, label
        )
        # It takes the name that --resume looks for once it says what it was begun with.
        beginning = stage_dir.path.with_suffix(_BEGINNING)
        _delete(beginning)  # of a call that was killed just here
        beginning.mkdir()
        try:
            stage_dir._lock = locks.take(beginning / LOCK)
            if work is not None:
                work.write(beginning)
            beginning.rename(stage_dir.path)
        except BaseException:
            shutil.rmtree(beginning, ignore_errors=True)
            raise
        return stage_dir

    def _resumed(
        self, run: str, stage: str, label: str, work: Work | None, version: str, or_begin: bool
    ) -> StageDir | None:
        everything = self.partials(run, stage)
        found = [
            one
            for one in everything
            if (one.final.name == version if version else label in ("", one.label))
        ]
        if not found and or_begin:
            return None
        if not found:
            raise self._nothing(run, stage, label, version)
        other = {one.final.name: _other_work(one, work) for one in found}
        same = [one for one in found if not other[one.final.name]]
        for stage_dir in reversed(same):
            if stage_dir._claim():
                stage_dir._reopen()
                return stage_dir
        unknown = [one for one in found if work is not None and Work.read(one.path) is None]
        busy = same or [one for one in (unknown if or_begin else found[-1:]) if one.held()]
        if busy:
            raise ArtifactError(
                f"{busy[-1].path}: another process is working on it; stop it or wait"
            )
        if or_begin:
            return None
        newest = found[-1]
        raise ArtifactError(
            f"{newest.path}: not the work asked for: {in_one_line(other[newest.final.name])}; leave"
            " out what differs to go on with it, or leave out --resume to begin another version"
        )

    def _nothing(self, run: str, stage: str, label: str, version: str) -> ArtifactError:
        what = f"version {version}" if version else f"'{label}'" if label else "version"
        unfinished = self.partials(run, stage)
        there = ", ".join(f"{one.final.name} {one.label}".strip() for one in unfinished)
        return ArtifactError(
            f"run '{run}': no unfinished {what} of {stage} to resume in {self.root}"
            f"{f' (unfinished: {there})' if there else ''}; leave out --resume"
        )


def _other_work(stage_dir: StageDir, work: Work | None) -> list[str]:
    """How the work of an unfinished version differs from what is asked for."""
    if work is None:
        return []
    begun = Work.read(stage_dir.path)
    if begun is None:
        return ["it does not say what it was begun with"]
    return begun.differences(work)


def remove_working(directory: Path) -> None:
    """Delete what served an unfinished version, in the directory that it left complete."""
    for path in working_files(directory):
        _delete(path)


def _delete(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@contextmanager
def _turn(root: Path) -> Iterator[None]:
    """One process at a time among all that work in these runs."""
    with locks.turn(root / NUMBERING):
        yield


def _list(directory: Path) -> list[Path]:
    with storage_errors(directory, "read"):
        return sorted(directory.iterdir()) if directory.is_dir() else []
