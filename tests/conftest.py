"""Fixtures that more than one room uses; everything else stands beside its tests."""

import os
import shutil
import tempfile
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def shared():
    """The folder of recorded mocap and papers beside the checkout; its licences keep it out."""
    folder = CHECKOUT / "../shared"
    if not (folder / "data" / "mocap").is_dir():
        pytest.skip("needs the recorded mocap of ../shared, which may not be redistributed")
    return folder


@pytest.fixture(autouse=True)
def _runs_in_a_temporary_folder(tmp_path, monkeypatch):
    """No test writes into the runs of whoever starts it."""
    monkeypatch.setenv("LACOLOCO_RUNS", str(tmp_path / "runs"))


@pytest.fixture
def read_only_folder():
    """A folder in which the process may read but not write, also when it is the superuser."""
    folder = Path(tempfile.mkdtemp(prefix="lacoloco-read-only-"))
    folder.chmod(0o555)
    superuser = os.geteuid() == 0
    if superuser:
        os.seteuid(65534)
    try:
        yield folder
    finally:
        if superuser:
            os.seteuid(0)
        folder.chmod(0o755)
        shutil.rmtree(folder)


@pytest.fixture
def full_disk():
    """A process that may write no file beyond 1 KiB: the operating system then refuses."""
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1024, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
