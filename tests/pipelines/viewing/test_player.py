"""The page of `play` in a headless Chromium, by keys, on a desk and on a phone."""

import numpy as np
import pytest

from lacoloco.pipelines.viewing.page import build_page
from lacoloco.pipelines.viewing.recording import Recording

FPS, FRAMES = 50.0, 101


@pytest.fixture
def address(solo12, tmp_path):
    """A page of four episodes of two seconds, of robots that stand."""
    pose = np.tile(solo12.default_qpos(), (FRAMES, 1))
    parts = pose[:, :3], pose[:, 3:7], pose[:, 7:]
    page = build_page(solo12, [Recording(f"episode {i}", FPS, *parts) for i in range(4)], "title")
    (tmp_path / "page.html").write_text(page)
    return (tmp_path / "page.html").as_uri()


@pytest.mark.slow
def test_keys_speed_and_episodes_side_by_side(browser, address):
    page = browser.new_page(viewport={"width": 900, "height": 600})
    page.set_default_timeout(60_000)
    failed = []
    page.on("pageerror", lambda error: failed.append(error))
    page.goto(f"{address}#t=1")
    frame, choice, speed = (
        lambda: int(page.locator("#scrubber").input_value()),
        page.locator("#choice"),
        page.locator("#speed"),
    )

    def shows(at):
        page.wait_for_function(f"document.getElementById('scrubber').value === '{at}'")

    shows(50)
    page.keyboard.press("ArrowRight")
    shows(51)
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowLeft")
    shows(49)
    page.keyboard.press("ArrowDown")
    shows(0)
    assert choice.input_value() == "1"
    page.keyboard.press("ArrowUp")
    assert choice.input_value() == "0"
    page.keyboard.press("-")
    assert speed.input_value() == "0.5"
    page.keyboard.press("+")
    assert speed.input_value() == "1"
    page.evaluate("speed.dispatchEvent(new Event('pointerdown')), speed.focus()")
    speed.select_option("0.1")
    assert page.evaluate("document.activeElement === document.body")
    page.keyboard.press("Space")
    page.wait_for_function("document.getElementById('play').textContent === 'pause'")
    page.wait_for_function("Number(document.getElementById('scrubber').value) > 0")
    page.keyboard.press("Space")
    page.wait_for_function("document.getElementById('play').textContent === 'play'")
    at = frame()
    page.wait_for_timeout(300)
    assert frame() == at
    page.locator("#count").select_option("4")
    assert page.locator(".pane:visible h2").all_inner_texts() == [f"episode {i}" for i in range(4)]
    assert not failed


@pytest.mark.slow
def test_it_fits_a_phone(browser, address):
    phone = browser.new_context(
        viewport={"width": 360, "height": 640}, is_mobile=True, has_touch=True
    )
    page = phone.new_page()
    page.set_default_timeout(60_000)
    page.goto(f"{address}#t=1&count=2")
    boxes = [box.bounding_box() for box in page.locator(".pane").all()]
    assert [box["width"] for box in boxes] == [360, 360]
    assert boxes[1]["y"] >= boxes[0]["y"] + boxes[0]["height"]
    for control in page.locator("#controls button, #controls select:visible").all():
        box = control.bounding_box()
        assert box["height"] >= 40 and box["x"] + box["width"] <= 360
        assert box["y"] + box["height"] <= 640
    page.locator("#play").tap()
    page.wait_for_function("document.getElementById('play').textContent === 'pause'")
