"""`lacoloco runs report`: tables that say where their figures come from, merged into prose."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from lacoloco.datasets.artifact import write_artifact
from lacoloco.datasets.store import RunStore
from lacoloco_cli import report_table
from lacoloco_cli.failures import UserError
from lacoloco_cli.main import app

HARDWARE = {"device": "cpu", "processor": "Abacus", "cores": 2, "torch": "2.13.0", "mujoco": "4.0"}
FALLS = {"drail": (0.2, 0.4), "gan": (1.0,)}


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setenv("LACOLOCO_RUNS", str(tmp_path / "runs"))
    return RunStore(tmp_path / "runs")


def evaluated(store, run, methods=FALLS, **metadata):
    """An evaluation of two episodes per policy, one of them within 5 cm."""
    rows = []
    arrays = {}
    parents = []
    for method, falls in methods.items():
        for seed, fell in enumerate(falls):
            arrays[f"{len(rows)}/error"] = np.array([0.01, 0.2])
            arrays[f"{len(rows)}/fell"] = np.array([False, False])
            row = {"method": method, "seed": seed, "episodes": 2, "ee_error_mean_m": 0.02 + seed}
            row |= {"falls_pct": fell, "selection_error_m": 0.1 * len(rows) + 0.1}
            rows.append(row)
            policy = store.begin(run, "train-high", label=f"{method}{seed}")
            policy.file("artifact.h5").write_bytes(f"{method}{seed}".encode())
            parents.append(policy.complete())
    directory = store.begin(run, "eval")
    write_artifact(
        directory.file("artifact.h5"),
        "lacoloco/evaluation",
        arrays,
        metadata={"rows": rows, "best": rows[0], "summary": {}, "hardware": HARDWARE, **metadata},
        config={},
        seed=0,
        robot=None,
        parents=parents,
        command=f"lacoloco eval --run {run}",
    )
    return directory.complete()


def invoke(*arguments):
    return CliRunner().invoke(app, ["runs", "report", *map(str, arguments)])


def test_means_come_first_and_the_best_seed_is_called_so(store):
    evaluated(store, "many")
    lines = invoke("many").stdout.splitlines()
    table = [line for line in lines if line.startswith("|")]
    assert "| method | seed | episodes | error mean [cm] | within 5 cm [%] |" in table[0]
    assert table[2].startswith(
        "| **drail** | mean of 2 |  | **52.00 +- 70.71 [-583.30, 687.30]** "
        "| **50.00 +- 0.00 [50.00, 50.00]**"
    )
    assert table[2].endswith("| **0.300 +- 0.141 [-0.971, 1.571]** |")
    assert table[3].startswith("| drail | 0, best on other episodes | 2 | 2.00 |")
    assert [line.split("|")[1].strip() for line in table[4:]] == ["drail", "gan"]
    assert sum("best" in line for line in table) == 1
    assert "sample standard deviation" in "".join(lines) and "One seed" in "".join(lines)


def test_a_hardware_shift_has_a_table_of_its_own(store):
    row = {"success_5cm_pct": 1.0, "ee_error_mean_m": 0.01}
    row |= {"name": "pd-1khz", "episodes": 256, "intervals": {"success_5cm_pct": [0.5, 2.0]}}
    evaluated(store, "shifted", shift=[row])
    lines = invoke("shifted").stdout.splitlines()
    heading = next(n for n, line in enumerate(lines) if line.startswith("| what is added"))
    assert lines[heading + 2].startswith("| pd-1khz | 256 | 1.00 | 1.00 [0.50, 2.00] |")
    assert "what is added" not in invoke(evaluated(store, "still").parent).stdout


def test_every_table_says_where_it_comes_from(store):
    path = evaluated(store, "many")
    text = invoke("many").stdout
    assert "`lacoloco eval --run many`" in text
    assert "2 cores of Abacus; torch 2.13.0; mujoco 4.0" in text
    assert text.count("train-high") == 3 and str(store.root) not in text
    from lacoloco.datasets.artifact import read_header

    header = read_header(path)
    assert header.content_hash[:16] in text
    assert all(parent.sha256[:16] in text for parent in header.parents)
    assert f"lacoloco {header.lacoloco_version}, commit " in text


def test_the_same_artifact_gives_the_same_file_and_prose_stays(store, tmp_path):
    path = evaluated(store, "many")
    file = tmp_path / "RESULTS.md"
    file.write_text("# Results\n\nProse before.\n")
    assert invoke(path, "--out", file).exit_code == 0
    first = file.read_text()
    assert first.startswith("# Results\n\nProse before.\n\n## many\n\n<!-- report: many -->\n")
    file.write_text(first.replace("## many", "## A better title") + "\nProse behind.\n")
    changed = file.read_text()
    assert invoke("many", "--out", file).exit_code == 0
    assert file.read_text() == changed


def test_a_newer_evaluation_replaces_the_table_of_its_name_only(store, tmp_path):
    file = tmp_path / "RESULTS.md"
    for run in ("one", "two"):
        evaluated(store, run)
    assert invoke("one", "two", "--out", file).exit_code == 0
    evaluated(store, "one", {"gan": (7.0,)})
    invoke("one", "--out", file)
    text = file.read_text()
    assert text.count("<!-- report: ") == 2
    assert text.index("<!-- report: one -->") < text.index("7.000") < text.index("report: two -->")
    assert "mean of 2" in text.split("<!-- report: two -->")[1]


def test_a_single_seed_has_no_spread_and_is_not_called_best(store):
    evaluated(store, "one", {"gan": (7.0,)})
    text = invoke("one").stdout
    assert "best" not in text and "+-" not in text
    assert "One seed, so no spread: gan." in text


def test_a_seed_s_own_interval_is_that_over_its_episodes(store):
    evaluated(store, "one", {"gan": (7.0,)})
    assert "bootstrap" not in invoke("one").stdout, "an evaluation of before has none"
    row = {"method": "gan", "seed": 0, "best": True, "episodes": 2, "falls_pct": 7.0}
    row["intervals"] = {"falls_pct": [5.5, 9.25]}
    lines = report_table.table([row])
    assert lines[2] == "| gan | 0 | 2 | 7.000 [5.500, 9.250] |"
    assert "bootstrap" in lines[-1]


def test_json_has_the_tables(store, tmp_path):
    evaluated(store, "many")
    answer = json.loads(invoke("many", "--name", "other", "--json").stdout)
    (report,) = answer["reports"]
    assert report["name"] == "other" and answer["out"] is None
    assert report["markdown"].startswith("<!-- report: other -->")


def test_mistakes_are_refused_in_one_line(store, tmp_path):
    evaluated(store, "many")
    for arguments, said in (
        (["none"], "none"),
        (["many", "many"], "a second table called many"),
        (["many", "--name", "a b"], "use letters, digits"),
        (["many", "other", "--name", "x"], "names one table"),
    ):
        result = invoke(*arguments)
        assert result.exit_code == 2, arguments
        assert result.stderr.count("\n") == 1 and said in result.stderr
    with pytest.raises(UserError, match="once, in this order"):
        report_table.merge("<!-- report: a -->", "a", "text")


def test_without_recorded_hardware_it_says_so():
    assert report_table.hardware(None) == "not recorded"
    gpu = {**HARDWARE, "device": "cuda", "gpu": "H100", "gpu_memory_gib": 79.0}
    assert report_table.hardware(gpu).startswith("H100 (79.0 GiB), 2 cores")
