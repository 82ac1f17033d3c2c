"""The live page in a headless Chromium, by keys, clicks and drags."""

import time

import numpy as np
import pytest

from lacoloco.datasets.rotations import to_matrix
from lacoloco.pipelines.exploring.latent_map import HeldLatents

PATIENCE = 60.0
"""s for what a browser without a GPU does, on a machine that does other things."""


def until(true):
    end = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < end, "nothing came of it"
        time.sleep(0.05)


def look_at(browser, address):
    page = browser.new_page(viewport={"width": 900, "height": 500})
    page.set_default_timeout(1000.0 * PATIENCE)
    page.goto(address)
    page.get_by_text("steps/s").wait_for()
    # a warning that there is no GPU lies over the scene
    page.add_style_tag(content=".mantine-Notifications-root { display: none }")
    return page


def pixel(shown, point):
    """Where in the browser's window a point (3,) of the scene is."""
    (client,) = shown.server.get_clients().values()
    camera = client.camera
    right, down, ahead = to_matrix(camera.wxyz).T @ (np.asarray(point) - camera.position)
    focal = 0.5 * camera.image_height / np.tan(0.5 * camera.fov)
    middle = 0.5 * np.array([camera.image_width, camera.image_height])
    return middle + focal * np.array([right, down]) / ahead


def drag(page, begin, end):
    page.mouse.move(*begin)
    page.mouse.down()
    for share in (0.25, 0.5, 0.75, 1.0):
        page.mouse.move(*(begin + share * (end - begin)))
        page.wait_for_timeout(100)
    page.mouse.up()


@pytest.mark.slow
def test_keys_sliders_and_the_map_reach_the_robot(browser, live, make_world):
    from lacoloco.pipelines.exploring.explorer import with_pictures
    from lacoloco.pipelines.exploring.map_board import MapBoard

    world = make_world()
    latents = np.concatenate((np.eye(7), -np.eye(7)))
    motion = latents[:, :4]
    poses = np.tile(world.spec.default_qpos(), (14, 1))
    fell = np.zeros(14, dtype=bool)
    held = HeldLatents(latents, motion, motion[:, 0], fell, {"walk": 1.0}, poses)
    found = with_pictures(world.spec, held, print)
    pictures = sum(picture is not None for _, picture in found)
    with live(world) as (address, shown):
        board = MapBoard(shown, held, found)
        page = look_at(browser, address)
        assert page.locator("img[src^='blob:'], img[src^='data:image/jpeg']").count() == pictures
        before = world.latent
        page.keyboard.press("n")
        until(lambda: not np.allclose(world.latent, before))
        page.keyboard.press("f")
        until(lambda: world.friction == pytest.approx(0.9))
        page.keyboard.press("g")
        until(lambda: world.friction == pytest.approx(1.0))
        assert shown.friction.value == pytest.approx(1.0)
        page.get_by_role("slider").first.press("Home")
        until(lambda: world.latent[0] < -0.99)
        page.get_by_role("button", name="turns left most").click()
        until(lambda: world.latent[2] > 0.99)

        corners = board.place_in_scene(board.map.points)
        outer = int(np.argmax(np.linalg.norm(board.map.points, axis=1)))
        page.mouse.click(*pixel(shown, corners[outer]))
        until(lambda: np.allclose(world.latent, latents[outer], atol=1e-4))
        begin, end = board.place_in_scene(np.array([[0.1, 0.2], [-0.5, 0.4]]))

        def wandered():
            drag(page, pixel(shown, begin), pixel(shown, end))
            page.wait_for_timeout(500)
            return np.allclose(board.map.place(world.latent), [-0.5, 0.4], atol=0.05)

        until(wandered)


@pytest.mark.slow
def test_a_target_is_dragged_and_the_high_level_switched_off(
    browser, live, make_world, monkeypatch
):
    from lacoloco.pipelines.exploring.target_handle import ARROWS, TargetHandle
    from lacoloco.pipelines.viewing.extent import standing_extent

    world, start = make_world("solo12-synthetic"), np.array([0.3, 0.0, 0.2])
    world.set_target(start)
    with live(world) as (address, shown):
        handle = TargetHandle(shown)
        page = look_at(browser, address)
        page.get_by_text("high level steers").wait_for()
        page.get_by_role("checkbox").first.uncheck()
        until(lambda: not world.high_steers)
        # A browser may take seconds for a drag; meanwhile a robot that walks leaves its view.
        monkeypatch.setattr(world, "step", lambda: None)
        shown.ask(world.reset)
        until(lambda: np.linalg.norm(world.qpos[:2]) < 0.05)
        tip = np.array([0.0, 0.0, 0.9 * ARROWS * standing_extent(world.spec).size])

        def lifted():
            """Where the browser lags, a try may catch another arrow, or none: each try begins with
            the target where it was, and waits until all that the one before sent has arrived.
            """
            handle.arrows.position = tuple(start)
            shown.ask(lambda: world.set_target(start))
            page.wait_for_timeout(500)
            if not np.allclose(world.target, start, atol=1e-4):
                return False
            arrow = start - [*world.qpos[:2], 0.0] + tip
            drag(page, pixel(shown, arrow), pixel(shown, arrow + [0.0, 0.0, 0.15]))
            page.wait_for_timeout(500)
            aside = np.abs(world.target - start)[:2].max()
            return world.target[2] > 0.28 and aside < 0.05

        until(lifted)
