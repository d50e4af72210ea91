"""Servers of pages over real sockets, in a client of tests, and in a browser."""

import http.client
import os
import re
import shutil
import socket
import subprocess
import sys
import threading
import warnings
from contextlib import contextmanager
from pathlib import Path

import pytest
import uvicorn
from websockets.sync.client import connect

from minorloop.page.auth import Authentication, Serving
from minorloop.page.connections import Limits
from minorloop.page.serving import serve

with warnings.catch_warnings():
    # Newer ones warn that the client of another package is preferred to httpx.
    warnings.simplefilter("ignore")
    from starlette.testclient import TestClient

__all__ = ["Running", "TestClient", "chromium", "fits", "missing", "opened", "printed_address"]
ROOT = Path(__file__).resolve().parents[3]
# Only WebGL is drawn in software: to draw the whole page so would keep a core busy.
FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader"]
SCREENSHOTS = os.environ.get("MINORLOOP_SCREENSHOTS")
LIMITS = Limits(unauthenticated=16, header=1.0)


class Running:
    """A server over real sockets, which can be stopped and started again."""

    def __init__(self, application):
        self.application, self.port = application, 0
        self.start()

    def start(self, authentication=None):
        listening = socket.create_server(("127.0.0.1", self.port))
        self.port = listening.getsockname()[1]
        self.host = f"127.0.0.1:{self.port}"
        self.authentication = authentication or Authentication("127.0.0.1", port=self.port)
        app = self.application(self.authentication)
        how = Serving(authentication=self.authentication, listening=listening)
        running = self

        class Server(uvicorn.Server):
            def __init__(self, config):
                super().__init__(config)
                running.server = self

        self.thread = threading.Thread(
            target=serve, args=(app, how), kwargs={"limits": LIMITS, "server": Server}
        )
        self.thread.start()
        self.cookie = f"{self.authentication.cookie}={self.authentication.token}"

    def stop(self):
        self.server.should_exit = True
        self.thread.join(30.0)
        assert not self.thread.is_alive()

    def raw(self, content=b"", seconds=10.0):
        found = socket.create_connection(("127.0.0.1", self.port), timeout=seconds)
        found.sendall(content)
        return found

    def ask(self, path, **headers):
        connection = http.client.HTTPConnection(self.host, timeout=20.0)
        connection.request("GET", path, headers={"Cookie": self.cookie, **headers})
        answer = connection.getresponse()
        found = answer.status, answer.read().decode()
        connection.close()
        return found

    def page(self, **headers):
        headers = {"Cookie": self.cookie, **headers}
        origin = f"http://{self.host}"
        address = f"ws://{self.host}/ws"
        return connect(address, origin=origin, additional_headers=headers, proxy=None)


def missing(what):
    """Skip loudly; on CI, where all of it has to be, fail."""
    sentence = f"the pages were not tried in a browser: {what}"
    if os.environ.get("CI"):
        pytest.fail(sentence)
    pytest.skip(sentence)


@contextmanager
def chromium(page):
    """A browser, if there is one and the page is built."""
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None:
        missing("there is no chromium; install the package of that name")
    if not page.is_file():
        missing("they are not built; run 'make pages', which needs node")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as started:
        found = started.chromium.launch(executable_path=path, args=FLAGS)
        yield found
        found.close()


@contextmanager
def printed_address(verb, *options):
    """The address that a verb prints, which serves it meanwhile."""
    command = [sys.executable, "-u", "-m", "minorloop", verb, "--port", "0", *options]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        yield re.search(r"open (\S+)", server.stdout.readline())[1]
    finally:
        server.terminate()
        status = server.wait(30)
        server.stdout.close()
    assert status == 0


@contextmanager
def opened(browser, address, *, script="", path=None, size=(1280, 720), **options):
    """A page, and the list of its errors, which has to be empty at the end."""
    # The policy of the pages forbids the scripts that the waiting for conditions uses.
    options = {"bypass_csp": True, **options}
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **options)
    try:
        page, troubles = context.new_page(), []
        page.set_default_timeout(60_000)
        page.on("pageerror", lambda error: troubles.append(str(error)))
        page.on("console", lambda said: troubles.append(said.text) if said.type == "error" else 0)
        if path is not None:
            page.add_init_script(path=path)
        if script:
            page.add_init_script(script)
        page.goto(address)
        yield page, troubles
        assert troubles == []
    finally:
        context.close()


def fits(page):
    """Whether the page is not wider than the window."""
    return page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")


def shoot(page, name, *, whole=False):
    if SCREENSHOTS:
        page.screenshot(path=str(ROOT / SCREENSHOTS / f"{name}.png"), full_page=whole)
