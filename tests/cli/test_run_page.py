import base64
import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from lacoloco.datasets.artifact import write_artifact
from lacoloco.datasets.store import RunStore
from lacoloco_cli.main import app

PNG = b"\x89PNG\r\n\x1a\n and what follows"


def invoke(*arguments):
    return CliRunner().invoke(app, ["runs", "page", *map(str, arguments)])


def made(store, stage, schema, parents=(), files=(), **metadata):
    """A complete version of a stage of the run `seen`."""
    directory = store.begin("seen", stage)
    for name, content in files:
        directory.file(name).parent.mkdir(exist_ok=True)
        directory.file(name).write_bytes(content)
    write_artifact(
        directory.file("artifact.h5"),
        schema,
        {"a": np.zeros(1)},
        metadata=metadata,
        config={},
        seed=3,
        robot=None,
        parents=parents,
        command=f"lacoloco {stage} --set note=<b>",
    )
    return directory.complete()


@pytest.fixture
def run():
    """A run `seen`, the last one used: a policy, its evaluation, its page, and a training."""
    store = RunStore()
    policy = made(
        store, "train-high", "lacoloco/policy", metrics={"final_error": 0.0251, "kl": 0.125}
    )
    rows = [{"method": "drail-cat", "seed": 3, "ee_error_mean_m": 0.0263, "intervals": {}}]
    evaluation = {"rows": rows, "best": rows[0], "summary": {}, "protocol": "development"}
    made(store, "eval", "lacoloco/evaluation", [policy], [("shift.png", PNG)], **evaluation)
    made(store, "play", "lacoloco/playback", [policy], [("playback.html", b"<p>\xc3\xa9</p>")])
    for name in ("coverage.png", "curves.png"):
        (store.root / "seen" / name).write_bytes(PNG)
    partial = store.begin("seen", "train-high")
    row = {"training": "train-high gan seed 3", "samples": 100, "reward": 0.5}
    partial.file("metrics.jsonl").write_text(json.dumps(row) + "\n")
    store.use("seen")
    return store.root / "seen"


def test_the_page_holds_all_of_a_run(run):
    result = invoke("--json")
    assert result.exit_code == 0, result.stderr
    page = (run / "page.html").read_text()
    assert json.loads(result.stdout)["bytes"] == len(page.encode())
    headings = re.findall(r"<h2>(.*?)</h2>", page)
    assert headings == ["Stages", "Results", "Curves", "Figures", "Playback", "Lineage"]
    assert "<td>lacoloco eval --set note=&lt;b&gt;</td>" in page
    assert "<td>unfinished</td>" in page
    assert "<td>final_error</td><td class=number>0.0251</td>" in page
    assert "<th>ee error mean m</th>" in page and "<td class=number>0.0263</td>" in page
    assert "<td>kl</td>" not in page  # nobody looks for it here
    assert base64.b64encode(PNG).decode() in page
    pictures = [base64.b64decode(text) for text in re.findall(r"base64,([^\"]+)", page)]
    # the curves, the coverage, the shift
    assert [one.startswith(b"\x89PNG") for one in pictures] == [True, True, True]
    assert "<figcaption>coverage.png</figcaption>" in page
    (packed,) = re.findall(r'<script type="text/plain" id="play-0001">(.*?)</script>', page)
    assert base64.b64decode(packed).decode() == "<p>é</p>"
    lineages = re.findall(r"<details open>(.*?)</details>", page, re.DOTALL)
    assert len(lineages) == 2 and all("train-high/0001/artifact.h5" in one for one in lineages)


def test_the_page_needs_nothing_from_anywhere(run):
    invoke()
    page = (run / "page.html").read_text()
    assert not re.findall(r"https?://|@import|fetch\(|src=\"(?!data:)|href=", page)
    assert '<meta name="viewport"' in page


def test_a_damaged_artifact_hides_no_other(run):
    path = RunStore().newest("seen", "eval")
    path.write_bytes(path.read_bytes()[:500])
    assert invoke().exit_code == 0
    page = (run / "page.html").read_text()
    assert "<td>damaged</td>" in page and 'class="bad"' in page
    assert "final_error" in page


def test_it_replaces_only_a_page_of_its_own_kind(run, tmp_path):
    mine = tmp_path / "mine.html"
    for _ in range(2):
        assert invoke("seen", "--out", mine).exit_code == 0
    mine.write_text("<!doctype html> of my own")
    for arguments, hint in (
        (["--out", mine], "not a page of a run"),
        (["--out", tmp_path / "a.pdf"], "ends in .html"),
        (["--out", run / "mine.html"], "runs hold what stages write"),
        (["sene"], "runs: seen"),
    ):
        result = invoke(*arguments)
        assert result.exit_code == 2 and hint in result.stderr, result.output
    assert mine.read_text() == "<!doctype html> of my own"
