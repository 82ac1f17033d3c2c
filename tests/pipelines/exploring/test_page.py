"""The live page in a headless Chromium, by keys, clicks and drags."""

import time

import numpy as np
import pytest

PATIENCE = 60.0
"""s for what a browser without a GPU does, on a machine that does other things."""


def until(true):
    end = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < end, "nothing came of it"
        time.sleep(0.05)


def look_at(browser, address):
    page = browser.new_page(viewport={"width": 640, "height": 480})
    page.set_default_timeout(1000.0 * PATIENCE)
    page.goto(address)
    page.get_by_text("steps/s").wait_for()
    return page


@pytest.mark.slow
def test_keys_and_a_slider_reach_the_robot(browser, live, make_world):
    world = make_world()
    with live(world) as (address, _):
        page = look_at(browser, address)
        before = world.latent
        page.keyboard.press("n")
        until(lambda: not np.allclose(world.latent, before))
        thumb = page.get_by_role("slider").first
        thumb.press("Home")  # the end of a slider
        until(lambda: world.latent[0] < -0.99)
        page.get_by_role("button", name="Reset (R)").click()
        until(lambda: np.linalg.norm(world.qpos[:2]) < 0.02)
