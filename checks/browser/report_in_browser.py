"""A report in headless Chromium, as `make test-report` runs it: every page opens, turns, filters, and can be used without a mouse.

The file's name keeps it from being collected by `make test`: it needs a browser. REPORT=FOLDER looks at a report that is there instead of
a small one made for the test; SCREENSHOTS=FOLDER keeps pictures.
"""

import io
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from tests.test_pipeline import UNEXPLAINED, made, manifest, vt  # noqa: F401

SIZES = {"desktop": {"width": 1280, "height": 900}, "phone": {"width": 390, "height": 844}}
ARGUMENTS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
RIM, CORNER = 2, 8
"""Pixels around the canvas, and in its rounded corners, that are the page's: dark pages are darker than the canvas by more than 12."""
OBJECTS = 12
"""Pages of objects that are opened at most."""
MILLISECONDS = 60_000


@pytest.fixture(scope="module")
def report(request) -> Path:
    if given := os.environ.get("REPORT"):
        return Path(given).resolve()
    data = request.getfixturevalue("made")
    vt("report", data)
    return data / "report"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        yield chromium
        chromium.close()


@pytest.fixture(params=[(size, scheme) for size in SIZES for scheme in ("light", "dark")], ids="-".join)
def page(request, browser) -> Iterator[Page]:
    """Open a page without network; fail the test if the page logs an error or requests anything from outside."""
    size, scheme = request.param
    context = browser.new_context(viewport=SIZES[size], color_scheme=scheme, offline=True)
    opened, wrong = context.new_page(), []
    opened.on("console", lambda message: message.type in ("error", "warning") and wrong.append(message.text))
    opened.on("pageerror", lambda error: wrong.append(str(error)))
    opened.on("requestfailed", lambda asked: wrong.append(f"{asked.url[:200]} failed"))
    opened.on("request", lambda asked: asked.url.startswith(("file:", "data:", "blob:")) or wrong.append(asked.url))
    yield opened
    if folder := os.environ.get("SCREENSHOTS"):
        opened.screenshot(path=Path(folder) / f"{request.node.name}.png", full_page=True)
    context.close()
    assert not [one for one in wrong if "GPU stall" not in one]  # ANGLE's remark on software rendering


def is_ready(page: Page) -> None:
    page.wait_for_selector(".viewer[data-ready]", timeout=MILLISECONDS)


def canvas_of(page: Page) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(page.locator("canvas").screenshot())).convert("RGB"))


def test_every_page_opens_is_accessible_and_fits_the_screen(report, page):
    waiting, seen, objects = ["index.html"], set(), 0
    while waiting:
        name = waiting.pop()
        if name in seen or (name.startswith("objects/") and objects == OBJECTS):
            continue
        seen.add(name)
        objects += name.startswith("objects/")
        page.goto((report / name).as_uri())
        if name.startswith("objects/"):
            is_ready(page)
        page.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")  # widths of folded tables count too
        assert page.evaluate("[...document.images].every((image) => image.loading === 'lazy' || image.naturalWidth > 0)"), name
        assert not page.evaluate("document.documentElement.scrollWidth > innerWidth"), f"{name} is wider than the screen"
        assert not page.evaluate("[...document.querySelectorAll('.wide')].some((table) => table.scrollWidth > table.clientWidth)"), name
        text = page.inner_text("main")
        assert not [words for words in UNEXPLAINED if words in text], name
        found = Axe().run(page, options={"preload": False}).response["violations"]
        assert not [(one["id"], one["nodes"][0]["html"][:200]) for one in found if one["impact"] in ("serious", "critical")], name
        links = page.evaluate("[...document.links].map((link) => link.href)")
        assert all(link.startswith(report.as_uri()) for link in links), name
        waiting += [link.removeprefix(f"{report.as_uri()}/").partition("#")[0] for link in links]
    assert {"index.html", "gallery.html", "figures.html", "results.html", "about.html"} < seen
    assert objects


def test_an_object_is_shown_turned_by_keys_and_its_parts_hidden(report, page):
    evaluated = sorted((report / "objects").glob("*.predictions.js"))
    name = evaluated[0].name.removesuffix(".predictions.js") if evaluated else sorted((report / "objects").glob("*.html"))[0].stem
    page.goto((report / "objects" / f"{name}.html").as_uri())
    is_ready(page)
    print(f"{name}: first picture after {page.locator('.viewer').get_attribute('data-ready')} ms")
    first = canvas_of(page)
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 50, "the canvas is blank"
    page.locator("canvas").focus()
    page.keyboard.press("ArrowLeft")
    turned = canvas_of(page)
    assert (turned != first).any()
    page.locator("input[value=hand]").uncheck()
    assert (canvas_of(page) != turned).any()
    assert "hand" not in page.locator(".viewer [role=status]").inner_text()
    if evaluated:
        assert page.locator("select[name=prediction]").input_value(), "no prediction is shown"
        assert "on the right: prediction" in page.locator(".viewer [role=status]").inner_text()
        left, right = np.array_split(canvas_of(page).reshape(-1, turned.shape[1], 3), 2, axis=1)
        assert all(len(np.unique(half.reshape(-1, 3), axis=0)) > 20 for half in (left, right))
        page.locator("select[name=prediction]").select_option("")
        page.wait_for_function("!document.querySelector('.viewer [role=status]').textContent.includes('prediction')")


def test_object_and_hand_fit_into_the_view_and_the_object_is_seen(report, page):
    page.goto((report / "objects" / f"{sorted((report / 'objects').glob('*.html'))[0].stem}.html").as_uri())
    is_ready(page)
    for grasp in range(page.locator("select[name=grasp] option").count()):
        page.locator("select[name=grasp]").select_option(str(grasp))
        page.wait_for_function(f"document.querySelector('.viewer [role=status]').textContent.startsWith('Grasp {grasp + 1}.')")
        shown = canvas_of(page).astype(int)[RIM:-RIM, RIM:-RIM]
        drawn = np.abs(shown - shown[CORNER, CORNER]).max(axis=-1) > 12
        for rows in (slice(CORNER), slice(-CORNER, None)):
            drawn[rows, :CORNER] = drawn[rows, -CORNER:] = False
        edges = [drawn[0], drawn[-1], drawn[:, 0], drawn[:, -1]]
        assert not any(edge.any() for edge in edges), "something is cut off"
        reach = [np.ptp(np.flatnonzero(drawn.any(axis=axis))) / drawn.shape[1 - axis] for axis in (0, 1)]
        assert max(reach) > 0.6, "the object is a speck"


def test_the_gallery_shows_the_objects_that_are_asked_for(report, page):
    page.goto((report / "gallery.html").as_uri())
    every = page.locator(".cards li").count()
    first = page.locator(".cards li").first.get_attribute("data-name")
    page.locator("input[name=search]").fill(first)
    assert page.locator(".cards li:visible").count() >= 1
    page.locator("input[name=search]").fill("no object is called this")
    assert page.locator(".cards li:visible").count() == 0
    assert f"0 of {every} objects" in page.locator("[role=status]").inner_text()
