"""A running service and a real browser; skipped where there is no Chromium to drive."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from backend.service.keys import make_key
from backend.service.service import open_service
from backend.service.settings import Settings
from tests.browser.meshes import draw_meshes

ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "samples" / "pendulum"
PREPARED = Path(__file__).parent / "prepared"
CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-background-networking",
)  # fmt: skip
COOKIE = "linktwin_key"
PATIENCE_MS = 60_000  # a browser without a graphics card, beside other work
SLOW = os.environ.get("LINKTWIN_SLOW") == "1"


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the service keeps everything."""
    return tmp_path_factory.mktemp("served")


@pytest.fixture(scope="session")
def served(folder: Path) -> Iterator[tuple[str, str]]:
    """Where the page of a running service is, and a key to it: one web process, one worker, an empty data folder."""
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine: install the distribution's package `chromium`")
    key = _key(folder)
    draw_meshes(SAMPLE, folder / "scratch" / "page" / "sample-pendulum")
    command = [sys.executable, "-c", "from backend.cli import main; main()"]
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "LINKTWIN_STALL_S": "120",
        "LINKTWIN_POLL_S": "0.1",
        "LINKTWIN_REQUIRE_KEYS": "1",
    }
    if not SLOW:
        jobs = [sys.executable, str(Path(__file__).parent / "job_command.py")]
        environment["LINKTWIN_JOB_COMMAND"] = json.dumps(jobs)
    log = (folder / "log.txt").open("w")
    serving = [*command, "serve", "--port", "0", "--data", str(folder)]
    with subprocess.Popen(
        serving, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=log, text=True
    ) as process:
        try:
            assert process.stdout is not None
            told = process.stdout.readline()
            assert told.startswith("serving"), (folder / "log.txt").read_text()
            page = told.split()[-1] + "/ui/"
            _until_it_answers(page, process)
            yield page, key
        finally:
            process.terminate()
            process.wait(20)
            log.close()


def _key(folder: Path) -> str:
    service = open_service(Settings(data_folder=str(folder)))
    try:
        return make_key(service.database, "newcomer")[1]
    finally:
        service.close()


@pytest.fixture(scope="session")
def address(served) -> str:
    """Where the page is."""
    return served[0]


def _until_it_answers(page: str, process: subprocess.Popen, within_s: float = 90.0) -> None:
    until = time.monotonic() + within_s
    while True:
        assert process.poll() is None, "the service ended"
        try:
            if httpx.get(page, timeout=within_s).status_code == 200:
                return
        except httpx.TransportError:
            assert time.monotonic() < until, "the service does not answer"


@pytest.fixture(scope="session")
def browser(served) -> Iterator:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield opened
        opened.close()


@pytest.fixture(scope="session")
def window(browser, served) -> Callable:
    """A fresh window of whoever has signed in; of a stranger where signed_in is False."""
    address, key = served

    def opened(signed_in: bool = True, **looks: Any):
        made = browser.new_context(**looks)
        made.set_default_timeout(PATIENCE_MS)
        made.set_default_navigation_timeout(PATIENCE_MS)
        if signed_in:
            made.add_cookies([{"name": COOKIE, "value": key, "url": address}])
        return made

    return opened


@pytest.fixture
def visit(window, address: str) -> Iterator[Callable]:
    """Open the page in a fresh window; at its end no script may have failed and nothing been fetched from elsewhere."""
    windows, faults = [], []
    here = address.split("/ui/")[0]

    def open_page(path: str = "", width: int = 1280, height: int = 900, scheme: str = "light", **more: Any):
        opened = window(viewport={"width": width, "height": height}, color_scheme=scheme, **more)
        page = opened.new_page()
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("request", lambda request: faults.append(request.url) if _strange(request.url, here) else None)
        page.goto(address + path)
        windows.append(opened)
        return page

    yield open_page
    for opened in windows:
        opened.close()
    assert faults == []


def _strange(url: str, here: str) -> bool:
    return not url.startswith((here, here.replace("http", "ws", 1), "data:", "blob:"))


@pytest.fixture(scope="session")
def study(window, address) -> str:
    """Path of the sample's study, opened the way a newcomer does."""
    with window() as opened:
        page = opened.new_page()
        page.goto(address)
        page.click("[data-sample=pendulum]")
        page.wait_for_url("**/studies/*")
        return page.url.split("/ui/")[1]


@pytest.fixture(scope="session")
def finished(window, address):
    """Begin a job by its button and wait until its report stands: (path, button, what the report shows) -> path."""

    def job(path: str, button: str, shows: str) -> str:
        with window() as opened:
            page = opened.new_page()
            page.goto(address + path)
            page.get_by_role("button", name=button).click()
            page.wait_for_url("**/jobs/*")
            page.wait_for_selector(shows, timeout=600_000 if SLOW else 90_000)
            return page.url.split("/ui/")[1]

    return job


@pytest.fixture(scope="session")
def diagnosis(finished, study) -> str:
    """Path of a finished diagnosis of it."""
    return finished(study, "Diagnose", ".badge")
