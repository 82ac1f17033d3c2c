import json

import pytest
from typer.testing import CliRunner

from lacoloco.datasets.clip import save_clips
from lacoloco.datasets.store import RunStore
from lacoloco.robots.registry import load_robot
from lacoloco_cli import play
from lacoloco_cli.main import app

PNG = b"\x89PNG\r\n\x1a\n and what follows"


def invoke(*arguments):
    return CliRunner().invoke(app, ["play", *map(str, arguments), "--quiet"])


@pytest.fixture
def motions(make_clip):
    """A run `seen`, the last one used, with motions."""
    from dataclasses import replace

    spec = load_robot("solo12")
    store = RunStore()
    directory = store.begin("seen", "retarget")
    clip = replace(make_clip(joints=12), joint_names=spec.joint_names)
    robot = (spec.name, spec.model_hash())
    save_clips(directory.file("artifact.h5"), [clip], robot=robot, config={})
    store.use("seen")
    return directory.complete()


def test_the_motions_of_the_run_become_a_page(motions, tmp_path):
    page = tmp_path / "page.html"
    result = invoke("--html", page, "--json")
    assert result.exit_code == 0, result.stderr
    answer = json.loads(result.stdout)
    assert answer["html"] == str(page)
    assert answer["recordings"] == ["circle"]
    assert "circle" in page.read_text()


def test_a_playback_is_played_again(motions, tmp_path):
    first = json.loads(invoke("--html", tmp_path / "a.html", "--json").stdout)
    again = invoke(first["artifact"], "--html", tmp_path / "b.html", "--json")
    assert json.loads(again.stdout)["recordings"] == ["circle"]


@pytest.mark.parametrize("as_json", [True, False])
def test_a_script_is_told_where_the_page_is_and_waits_for_no_browser(motions, monkeypatch, as_json):
    if as_json:  # in a terminal, too; without a terminal nothing has to be said
        monkeypatch.setattr(play, "watched", lambda: True)
    monkeypatch.setattr(play, "show", lambda page: pytest.fail(f"{page} was shown"))
    result = invoke("--json") if as_json else invoke()
    assert result.exit_code == 0, result.stderr
    page = json.loads(result.stdout)["html"] if as_json else result.stdout.strip()
    assert page.endswith("playback.html")


def interrupted():
    raise KeyboardInterrupt


def test_without_a_screen_the_address_is_printed(motions, monkeypatch):
    monkeypatch.setattr(play, "watched", lambda: True)
    monkeypatch.setattr(play, "forever", interrupted)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    result = invoke()
    assert result.exit_code == 0, result.stderr
    assert "http://127.0.0.1:" in result.stderr


def test_a_run_with_nothing_to_play_says_how_to_get_something(tmp_path):
    result = invoke("--html", tmp_path / "page.html")
    assert result.exit_code == 2
    assert "lacoloco retarget" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["--clip", "squar"], "circle"),
        (["gone.h5"], "gone.h5"),
        (["--html", "/gone/page.html"], "/gone/page.html"),
        (["--html", "page.mp4"], "ends in .html"),
        (["--latents", "many"], "random"),
        (["--latents", "-1"], "random"),
    ],
)
def test_mistakes_on_the_command_line(motions, tmp_path, arguments, hint):
    html = [] if "--html" in arguments else ["--html", tmp_path / "page.html"]
    result = invoke(*arguments, *html)
    assert result.exit_code == 2
    assert hint in result.stderr
    assert not (tmp_path / "page.html").exists()


def test_a_damaged_artifact_is_refused(motions, tmp_path):
    damaged = tmp_path / "half.h5"
    damaged.write_bytes(motions.read_bytes()[:1000])
    result = invoke(damaged, "--html", tmp_path / "page.html")
    assert result.exit_code == 2
    assert "half.h5" in result.stderr


def test_a_figure_is_drawn_instead_of_a_page(motions, tmp_path, monkeypatch):
    from lacoloco.pipelines import switching
    from lacoloco.pipelines.stage import StageResult

    asked = []

    def run(config, context, *, policy, motions):
        asked.append((config, policy, motions))
        picture = tmp_path / "switching.png"
        picture.write_bytes(PNG)
        metrics = {"walk_first_reach_last": 0.25, "episodes": 4, "picture": str(picture)}
        return StageResult(tmp_path / "artifact.h5", metrics)

    monkeypatch.setattr(switching, "run", run)
    figure = tmp_path / "mine.png"
    policy = tmp_path / "policy.h5"
    policy.touch()
    options = (policy, "--figure", figure, "--motions", motions, "--preset", "smoke")
    result = invoke(*options)
    assert result.stdout.splitlines() == [
        "25.0% of 4 episodes walk first and reach last",
        str(figure),
    ]
    assert figure.read_bytes() == PNG
    assert json.loads(invoke(*options, "--json").stdout)["walk_first_reach_last"] == 0.25
    assert asked[0][0] == switching.PRESETS["smoke"]()
    assert asked[0][1:] == (policy, [motions])


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["p.h5", "--figure", "a.png", "--clip", "circle"], "--clip"),
        (["p.h5", "--figure", "a.bmp"], "a name that ends in .png"),
        (["p.h5", "--figure", "/gone/a.png"], "/gone/a.png"),
        (["--motions", "m.h5"], "--figure"),
        (["--figure", "a.png"], "train-high"),
    ],
)
def test_mistakes_about_figures(motions, arguments, hint):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert hint in result.stderr
    assert result.stderr.count("\n") == 1


GIF, MP4 = b"GIF89a and what follows", b"\0\0\0\x20ftypisom and what follows"


@pytest.fixture
def drawn(monkeypatch):
    """Stands in for the drawing; what was drawn."""
    from lacoloco.pipelines.viewing import mp4, opengl, render

    shown = []

    def draw(content):
        def render(spec, recording, look, progress):
            shown.append((spec.name, recording.name, recording.frames, look))
            return content

        return render

    monkeypatch.setattr(opengl, "check_gl", lambda: None)
    monkeypatch.setattr(mp4, "check_mp4", lambda: None)
    monkeypatch.setattr(render, "render_gif", draw(GIF))
    monkeypatch.setattr(render, "render_mp4", draw(MP4))
    return shown


@pytest.mark.parametrize(
    ("option", "ending"), [("--video", "gif"), ("--gif", "gif"), ("--video", "mp4")]
)
def test_a_film_is_drawn_instead_of_a_page(motions, drawn, tmp_path, option, ending):
    from lacoloco.pipelines.viewing import render

    film = tmp_path / f"circle.{ending}"
    for _ in range(2):  # an earlier one may be replaced
        result = invoke(option, film, "--clip", "circle", "--set", "seconds=0.5", "--json")
        assert result.exit_code == 0, result.stderr
    content, look = {"gif": (GIF, render.GIF_LOOK), "mp4": (MP4, render.MP4_LOOK)}[ending]
    assert film.read_bytes() == content
    assert json.loads(result.stdout) == {
        "video": str(film),
        "bytes": len(content),
        "robot": "solo12",
        "recording": "circle",
        "seconds": 0.5,
    }
    assert drawn == [("solo12", "circle", 26, look)] * 2
    assert not list(RunStore().directory("seen", "play").glob("*"))
    assert [file.name for file in tmp_path.iterdir() if file.is_file()] == [film.name]


def test_a_film_looks_as_asked(motions, drawn, tmp_path):
    options = [
        "--speed",
        "0.25",
        "--camera",
        "fixed",
        "--azimuth",
        "90",
        "--elevation",
        "-10",
        "--size",
        "1280x720",
    ]
    assert invoke("--video", tmp_path / "a.mp4", *options).exit_code == 0
    look = drawn[0][3]
    assert (look.speed, look.camera, look.azimuth, look.elevation) == (0.25, "fixed", 90, -10)
    assert (look.width, look.height, look.fps) == (1280, 720, 25)


def test_a_gif_replaces_nothing_else(motions, drawn, tmp_path):
    notes = tmp_path / "notes.gif"
    notes.write_text("not a picture")
    inside = motions.with_name("circle.gif")
    link = tmp_path / "link.gif"
    link.symlink_to(inside)
    text = tmp_path / "ftyp.mp4"
    text.write_text("ftyp")
    refused = ((notes, "not a GIF"), (inside, "runs"), (link, "runs"), (text, "not a MP4"))
    for place, hint in refused:
        result = invoke("--gif", place)
        assert result.exit_code == 2
        assert hint in result.stderr
    assert notes.read_text() == "not a picture"
    assert not inside.exists()
    assert drawn == []


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["--gif", "/gone/a.gif"], "/gone/a.gif"),
        (["--video", "a.avi"], "ends in .mp4 or .gif"),
        (["--video", "a.mp4", "--html", "a.html"], "--html"),
        (["--video", "a.mp4", "--speed", "0"], "--speed 0.0: use a number from 0.05 to 20"),
        (["--video", "a.mp4", "--camera", "drone"], "--camera drone: use one of target, follow"),
        (["--video", "a.mp4", "--elevation", "45"], "--elevation 45.0: use a number from -89"),
        (["--video", "a.mp4", "--size", "641x480"], "even numbers"),
        (["--video", "a.mp4", "--size", "8x8"], "--size 8x8: use a whole number from 16"),
        (["--speed", "2"], "--speed: of a film"),
        (["--gif", "a.gif", "--html", "a.html"], "--html"),
        (["--gif", "a.gif", "--clip", "circle", "--clip", "circle"], "one --clip"),
        (["--gif", "a.gif", "--clip", "squar"], "circle"),
        (["p.h5", "--figure", "a.png", "--gif", "a.gif"], "--video"),
    ],
)
def test_mistakes_about_films(motions, drawn, tmp_path, monkeypatch, arguments, hint):
    monkeypatch.chdir(tmp_path)
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert hint in result.stderr
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "a.gif").exists()


def test_without_opengl_one_line_says_what_to_install(motions, tmp_path, monkeypatch):
    from lacoloco.pipelines.viewing import opengl

    def missing():
        raise OSError("no such library")

    monkeypatch.setattr(opengl, "_context_class", missing)
    result = invoke("--gif", tmp_path / "a.gif")
    assert result.exit_code == 2
    assert "OpenGL" in result.stderr
    assert result.stderr.count("\n") == 1


def test_a_run_is_played_by_its_folder_or_its_name(motions, tmp_path):
    for source in (RunStore().directory("seen"), "seen", motions.parent):
        result = invoke(source, "--html", tmp_path / "page.html", "--json")
        assert result.exit_code == 0, result.stderr
        assert json.loads(result.stdout)["recordings"] == ["circle"]
    empty = RunStore().directory("empty")
    empty.mkdir()
    result = invoke(empty, "--html", tmp_path / "page.html")
    assert result.exit_code == 2 and "run 'empty' has nothing to play" in result.stderr


def test_a_playback_belongs_to_the_run_that_is_played(motions, tmp_path):
    RunStore().use("another")
    for arguments, run in ((["seen"], "seen"), (["seen", "--run", "mine"], "mine")):
        result = invoke(*arguments, "--html", tmp_path / "page.html", "--json")
        assert result.exit_code == 0, result.stderr
        assert RunStore().newest(run, "play").parent.parent.parent.name == run


def test_the_page_is_served_at_the_port_asked_for(motions, monkeypatch):
    import socket

    monkeypatch.setattr(play, "watched", lambda: True)
    monkeypatch.setattr(play, "forever", interrupted)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        result = invoke("--port", port)
        assert result.exit_code == 2
        assert f"--port {port}: " in result.stderr and result.stderr.count("\n") == 1
    result = invoke("--port", port)
    assert f"http://127.0.0.1:{port}/" in result.stderr
