"""The house: its words, its listing and its sizes."""

import re
import subprocess
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[1]
DIALECT = (
    r"whoever|rematch|boldness|bold_share|bold spell|second.chance|rehears|steered.fall|steadiness"
    r"|deterministic_share|head.start|beginnings|put_back|retries|taken_up|crowds"
    r"|performances|\btally\b|hip_columns|force_price|\bfacts \d"
)
"""Words of before; CHANGELOG.md and the table of old names tell what they are called today."""
OLD_NAMES = ("CHANGELOG.md", "datasets/old_names.py", "tests/test_house.py")
ROBOTS = r"len\(.*feet\) *== *4|_solo_or|HAA|hip_roll"
MACHINE = r"(?<![\w.])/(home|root|work|mnt)/[a-z]"


def tracked(*suffixes):
    listed = subprocess.run(
        ["git", "ls-files"], cwd=CHECKOUT, capture_output=True, text=True, check=False
    ).stdout.split("\n")
    files = [Path(name) for name in listed if name.endswith(suffixes)]
    if not files:
        pytest.skip("not a git checkout")
    return [file for file in files if (CHECKOUT / file).is_file()]


def lines_with(pattern, files):
    found = re.compile(pattern, re.IGNORECASE)
    return [
        f"{file}:{number}"
        for file in files
        for number, line in enumerate((CHECKOUT / file).read_text().splitlines(), 1)
        if found.search(line)
    ]


def test_words_of_before_do_not_come_back():
    files = [file for file in tracked(".py", ".md", ".toml") if str(file) not in OLD_NAMES]
    assert lines_with(DIALECT, files) == []


def test_what_pipelines_lists_is_the_chain():
    assert len(list((CHECKOUT / "pipelines").glob("*.py"))) <= 15


def test_pipelines_assume_no_robot():
    files = [file for file in tracked(".py") if file.parts[0] == "pipelines"]
    found = re.compile(ROBOTS)
    assert [file for file in files if found.search((CHECKOUT / file).read_text())] == []


def test_no_file_names_a_place_of_one_machine():
    texts = (".py", ".md", ".toml", ".yml", ".yaml", ".cff", ".xml", ".json", "Makefile", "run")
    files = tracked(*texts)
    files = [file for file in files if file.name != "test_house.py"]
    assert lines_with(MACHINE, files) == []


def test_text_is_at_most_120_columns_wide():
    wide = [
        f"{file}:{number}"
        for file in tracked(".md")
        for number, line in enumerate((CHECKOUT / file).read_text().splitlines(), 1)
        if len(line) > 120 and not line.startswith(("|", "    ")) and "](" not in line
    ]
    assert wide == []


def test_no_module_is_longer_than_400_lines():
    files = tracked(".py")
    assert [f for f in files if len((CHECKOUT / f).read_text().splitlines()) > 400] == []
