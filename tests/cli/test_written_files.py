"""What is written where the user asked for it never costs them another file."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from lacoloco.datasets.artifact import write_artifact
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines import play as playback
from lacoloco.pipelines import switching
from lacoloco.pipelines.stage import StageResult
from lacoloco_cli.failures import UserError
from lacoloco_cli.main import app
from lacoloco_cli.written_files import PAGE, TEXT, check_output, copy_to

HTML = b"<!DOCTYPE html>\n<html><style>#meshcat-pane { width: 1px }</style></html>"
PNG = b"\x89PNG\r\n\x1a\n..."
OF_KIND = {PAGE: HTML, "png": PNG, "gif": b"GIF89a...", "svg": b"<?xml?>\n<svg/>",
           "pdf": b"%PDF-1.4", TEXT: b"# Results\n"}  # fmt: skip
BINARY = [b"\x89HDF\r\n\x1a\n\0", b"\xff\xfe\0", PNG]
OTHERS = [*BINARY, b"<!DOCTYPE html><p>my thesis</p>", b"notes"]


def write(path, schema="lacoloco/policy"):
    return write_artifact(
        path,
        schema,
        {"a": np.zeros(1)},
        metadata={},
        config={},
        seed=0,
        robot=None,
    )


@pytest.fixture
def artifact():
    """A complete version in the runs."""
    directory = RunStore().begin("seen", "train-high")
    write(directory.file("artifact.h5"))
    directory.file("report.png").write_bytes(PNG)
    directory.file("playback.html").write_bytes(HTML)
    row = {"training": "train-high gan seed 3", "samples": 100, "reward": 0.5}
    directory.file("metrics.jsonl").write_text(json.dumps(row) + "\n")
    RunStore().use("seen")
    return directory.complete()


@pytest.fixture
def stages(monkeypatch, tmp_path):
    """Stages that only say what they made."""
    made = tmp_path / "made"
    made.mkdir()
    (made / "page.html").write_bytes(HTML)
    (made / "picture.png").write_bytes(PNG)
    metrics = {"html": str(made / "page.html"), "picture": str(made / "picture.png")}
    metrics |= {"walk_first_reach_last": 0.5, "episodes": 2}
    calls = []

    def run(config, context, **inputs):
        calls.append(inputs)
        return StageResult(made / "artifact.h5", metrics)

    monkeypatch.setattr(playback, "run", run)
    monkeypatch.setattr(switching, "run", run)
    return SimpleNamespace(calls=calls, page=made / "page.html", picture=made / "picture.png")


def outputs(place):
    """Every command that writes a file where it is told to."""
    policy = str(RunStore().newest("seen", "train-high"))
    return [
        ["play", policy, "--html", place],
        ["play", policy, "--figure", place],
        ["play", policy, "--video", place],
        ["runs", "plot", "seen", "--out", place],
        ["runs", "report", policy, "--out", place],
    ]


@pytest.mark.parametrize("number", range(5))
def test_no_option_writes_among_the_runs_or_over_something_else(artifact, stages, tmp_path, number):
    elsewhere = RunStore(tmp_path / "other").begin("dog", "play")
    ending = ("html", "png", "gif", "svg", "md")[number]
    places = [artifact, artifact.with_name("report.png"), artifact.with_name("playback.html")]
    places += [artifact.with_name(f"new.{ending}"), RunStore().root / f"new.{ending}"]
    places += [elsewhere.file(f"a.{ending}"), artifact.with_name("report.bmp")]
    link, mine = tmp_path / f"link.{ending}", write(tmp_path / f"policy.{ending}")
    mine.write_bytes(b"\0 of another kind")
    link.symlink_to(artifact.with_name("report.png"))
    for place in (*places, link, mine):
        before = place.read_bytes() if place.exists() else None
        command = outputs(str(place))[number]
        result = CliRunner().invoke(app, command)
        assert result.exit_code == 2, (command, result.output)
        assert command[-2] in result.stderr and result.stderr.count("\n") == 1
        assert (place.read_bytes() if place.exists() else None) == before
    assert stages.calls == [], "refused before the work"


@pytest.mark.parametrize("kind", OF_KIND)
def test_only_a_file_of_the_same_kind_is_replaced(tmp_path, kind):
    file = tmp_path / "mine"
    runs = tmp_path / "runs"
    assert check_output("--out", file, kind, runs) == file
    for content in (b"", OF_KIND[kind]):
        file.write_bytes(content)
        assert check_output("--out", file, kind, runs) == file
    others = {*OF_KIND.values(), *OTHERS} - {OF_KIND[kind]}
    for content in BINARY if kind == TEXT else others:
        file.write_bytes(content)
        with pytest.raises(UserError, match="exists and is not a"):
            check_output("--out", file, kind, runs)


@pytest.mark.parametrize("name", ["/dev/null", "/dev/zero"])
def test_what_is_no_file_is_not_replaced(tmp_path, name):
    with pytest.raises(UserError, match="exists and is not a"):
        check_output("--out", tmp_path.joinpath(name), "png", tmp_path / "runs")


def test_on_a_full_disk_the_older_page_stays(artifact, stages, tmp_path, full_disk):
    page = tmp_path / "page.html"
    page.write_bytes(HTML)
    stages.page.write_bytes(HTML + b"x" * 5000)
    with full_disk(), pytest.raises(UserError, match="it is in"):
        copy_to("--html", stages.page, page)
    assert page.read_bytes() == HTML
    assert not list(tmp_path.glob(".writing*"))
    copy_to("--html", stages.page, page)
    assert page.read_bytes() == stages.page.read_bytes()


def test_a_link_to_a_page_is_followed_and_stays(artifact, stages, tmp_path):
    page, link = tmp_path / "page.html", tmp_path / "link.html"
    page.write_bytes(HTML)
    link.symlink_to(page)
    stages.page.write_bytes(HTML + b"newer")
    policy = str(artifact)
    assert CliRunner().invoke(app, ["play", policy, "--html", str(link)]).exit_code == 0
    assert link.is_symlink() and page.read_bytes() == HTML + b"newer"


def test_a_folder_for_copies_of_a_benchmark_holds_nothing_else(tmp_path, artifact):
    from lacoloco_cli.bench import check_folder

    new, taken = tmp_path / "new", tmp_path / "taken"
    taken.mkdir()
    (taken / "notes.txt").write_text("mine")
    runs = RunStore().root
    check_folder("--out", new, runs)
    for ours in ("figures.json", "metrics.json"):
        (new / ours).write_text("{}")
        check_folder("--out", new, runs)
        (new / ours).unlink()
    for folder in (taken, artifact.parent, taken / "notes.txt"):
        with pytest.raises(UserError, match="--out"):
            check_folder("--out", folder, runs)
