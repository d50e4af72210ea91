"""The operate page in a real browser: what an operator does and sees."""

import json
import re
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from console_rig import PIT
from minorloop_head.console.server import STATIC
from page_rig import ROOT, chromium, fits, missing, opened, printed_address, shoot

IWER = ROOT / "web" / "node_modules" / "iwer" / "build" / "iwer.min.js"
GAMEPAD = """
  window.pad = { connected: true, axes: [0, 0, 0, 0],
    buttons: Array.from({ length: 17 }, () => ({ pressed: false, value: 0 })) };
  navigator.getGamepads = () => [window.pad];
"""
HEADSET = """
  window.worn = new IWER.XRDevice(IWER.metaQuest3);
  window.worn.installRuntime({ forceInstall: true });
"""


@pytest.fixture(scope="module")
def browser():
    with chromium(STATIC / "index.html") as found:
        yield found


@pytest.fixture(scope="module")
def address(browser, tmp_path_factory):
    """A console with a long timeout, so that it does not hold on a slow machine."""
    folder = tmp_path_factory.mktemp("console")
    with printed_address("console", "--timeout", "5", "--folder", str(folder)) as found:
        yield found


class Operator:
    """A page and its user."""

    def __init__(self, page):
        self.page = page

    def wait(self, condition):
        self.page.wait_for_function(condition, polling=100)

    def state(self, name):
        return self.page.evaluate(f"document.body.dataset.{name}")

    def command(self):
        return np.array(self.state("command").split(), dtype=float)

    def in_mode(self, mode):
        self.wait(f"document.body.dataset.mode === '{mode}'")

    def pick(self):
        """Pick the first candidate by keyboard; there is one when the head rests."""
        picked = self.page.locator("#guide li:nth-child(3).now")
        for _ in range(40):
            self.page.keyboard.press("n")
            self.page.keyboard.press("Enter")
            self.page.wait_for_timeout(500)
            if picked.count():
                return
        raise AssertionError("no candidate could be picked")

    @contextmanager
    def looking_away(self):
        """Draw nothing for a while: to decode and draw pictures keeps half a core busy."""
        self.page.evaluate("document.body.style.display = 'none'")
        yield
        self.page.evaluate("document.body.style.display = ''")

    def enter(self, key, mode):
        """Press a key until its mode is on; a console that compiles has no picture at first."""
        for _ in range(240):
            self.page.keyboard.press(key)
            self.page.wait_for_timeout(500)
            if self.state("mode") == mode:
                return
        raise AssertionError(f"{mode} was never on")

    def take_by_key(self):
        """Press T until the controls are taken: one press is lost while a process starts anew."""
        for _ in range(30):
            self.page.keyboard.press("t")
            for _ in range(20):
                self.page.wait_for_timeout(200)
                if self.state("pilot") == "yes":
                    return
        raise AssertionError("the controls were never taken")

    def take(self):
        self.page.click("#take")
        self.wait("document.body.dataset.pilot === 'yes'")
        return self

    def release(self):
        if self.state("pilot") == "yes":
            self.page.click("#take")
            self.wait("document.body.dataset.pilot === 'no'")

    def moved(self, way):
        """Wait until the command of an axis meets a condition such as 'pan > 5'."""
        axis, rest = way.split(" ", 1)
        k = ("pan", "tilt").index(axis)
        self.wait(f"Number(document.body.dataset.command.split(' ')[{k}]) {rest}")


@contextmanager
def operating(browser, address, **options):
    with opened(browser, address, **options) as (page, _):
        operator = Operator(page)
        # A console compiles and identifies its wires before its first picture.
        page.wait_for_selector("#veil", state="hidden", timeout=300_000)
        page.wait_for_selector("body[data-command]")
        yield operator
        operator.release()


@pytest.mark.whole
def test_a_pit_is_inspected_with_the_keyboard_alone(browser, address):
    with operating(browser, address) as operator:
        page = operator.page
        at_step = "document.querySelector('#guide li:nth-child({}).now')"
        operator.take_by_key()
        operator.enter("1", "HEAD")
        page.keyboard.down("ArrowRight")
        operator.moved("pan > 15")
        page.keyboard.up("ArrowRight")
        page.keyboard.down("ArrowDown")
        operator.moved("tilt < -6")
        page.keyboard.up("ArrowDown")
        operator.pick()
        operator.enter("2", "TRACK")
        with operator.looking_away():
            operator.wait(at_step.format(4))  # it has come to the middle, and into focus
        page.keyboard.press("m")
        page.wait_for_selector("#findings li")
        assert re.search(r"⌀ (0\.9|1\.0)\d ±", page.inner_text("#findings"))
        page.wait_for_selector("#depth:not([disabled])")
        page.keyboard.press("e")
        operator.in_mode("SCAN")
        page.wait_for_selector("#guide progress:not([hidden])")
        with operator.looking_away():
            # A scan takes a minute, and the fit shares two cores.
            page.wait_for_function(at_step.format(6), polling=500, timeout=300_000)
        finding = downloaded(page, "/api/findings.json")["findings"][0]
        assert finding["verdict"] == "measured"
        assert finding["diameter"] == pytest.approx(1e3 * PIT[2], abs=0.06)
        assert finding["depth"] == pytest.approx(1e3 * PIT[3], abs=0.015)
        assert finding["z"] == pytest.approx(1e3 * PIT[1], abs=4 * finding["z_sd"])
        with page.expect_download() as waiting:
            page.click("a[href='/api/findings/1.ply']")
        assert Path(waiting.value.path()).read_bytes().startswith(b"ply")
        page.wait_for_selector("#solid canvas")
        assert fits(page)
        shoot(page, "operate")
        page.keyboard.press("Escape")
        page.click("[aria-label='Delete finding 1']")
        page.wait_for_selector("#findings li", state="detached")


def downloaded(page, path):
    with page.expect_download() as waiting:
        page.click(f"a[href='{path}']")
    return json.loads(Path(waiting.value.path()).read_text())


@pytest.mark.whole
def test_the_mouse_looks_picks_and_clutches(browser, address):
    with operating(browser, address) as operator:
        page = operator.take().page
        page.keyboard.press("Enter")  # must not press the clicked Take button again
        page.click("button[data-mode=HEAD]")
        operator.in_mode("HEAD")
        assert operator.state("pilot") == "yes"
        box = page.locator("#camera").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x - 200, y, steps=10)
        page.mouse.up()
        operator.moved("pan > 5")
        page.keyboard.down("c")
        page.wait_for_selector("#clutch[aria-pressed=true]")
        before = operator.command()
        page.keyboard.down("ArrowLeft")
        operator.wait("document.querySelector('#mode').textContent === 'CLUTCH'")
        page.keyboard.up("ArrowLeft")
        assert np.abs(operator.command() - before).max() <= 0.1
        page.keyboard.up("c")
        page.click("#camera", position={"x": 400, "y": 300})
        page.wait_for_selector("#guide li:nth-child(2).done")
        page.click("button[data-mode=HEAD]")
        reached = operator.command()[1]
        page.keyboard.down("ArrowUp")  # a clicked button must not keep the arrow keys
        operator.moved(f"tilt > {reached + 2}")
        page.keyboard.up("ArrowUp")


def test_one_steers_and_the_others_watch(browser, address):
    with operating(browser, address) as pilot, operating(browser, address) as watcher:
        pilot.take()
        watcher.wait("document.querySelector('#take').textContent.includes('steers')")
        assert watcher.page.is_disabled("button[data-mode=HEAD]")
        pilot.page.keyboard.press("1")
        watcher.in_mode("HEAD")
        watcher.page.click("#take")
        watcher.page.wait_for_selector("#notice:has-text('has the controls')")
        assert watcher.state("pilot") == "no"
        pilot.page.goto("about:blank")
        watcher.in_mode("HOLD")
        watcher.wait("document.querySelector('#take').textContent.startsWith('Take')")
        watcher.take()
        pilot.state = lambda name: "no"


@pytest.mark.whole
def test_a_phone_steers_by_its_orientation(browser, address):
    size = (390, 844)
    with operating(browser, address, size=size, has_touch=True, is_mobile=True) as operator:
        page = operator.page
        assert fits(page)
        turn = page.context.new_cdp_session(page)

        def hold(alpha, beta):
            orientation = {"alpha": alpha, "beta": beta, "gamma": 0}
            turn.send("DeviceOrientation.setDeviceOrientationOverride", orientation)

        hold(90, 90)  # upright
        operator.take()
        assert fits(page)
        assert "(T)" not in page.inner_text("#guide")
        page.select_option("#source", "phone")
        # Browsers report an orientation only when it changes, and a hand is never still.
        for k in range(1000):
            hold(90 - 0.3 * (k % 2), 90)
            if operator.state("mode") == "HEAD":
                break
            page.tap("button[data-mode=HEAD]")
        for step in range(1000):
            hold(90 - min(0.5 * step, 40), 90 - 0.2 * (step % 2))
            if operator.command()[0] > 5:
                break
        operator.moved("pan > 5")
        shoot(page, "phone")


@pytest.mark.whole
def test_a_headset_steers_and_its_loss_holds(browser, address):
    if not IWER.is_file():
        missing("the headset's emulator is not there; run 'make pages', which needs node")
    with operating(browser, address, path=IWER, script=HEADSET) as operator:
        page = operator.take().page
        page.select_option("#source", "headset")
        operator.wait("document.querySelector('#source').value === 'headset'")
        operator.enter("1", "HEAD")
        half = np.radians(-30.0) / 2
        page.evaluate(f"window.worn.quaternion.set(0, {np.sin(half)}, 0, {np.cos(half)})")
        operator.moved("pan > 5")
        page.evaluate("window.worn.activeSession.end()")
        operator.in_mode("HOLD")


@pytest.mark.whole
def test_a_gamepad_steers(browser, address):
    with operating(browser, address, script=GAMEPAD) as operator:
        page = operator.take().page
        page.evaluate("window.pad.buttons[2].pressed = true")
        operator.in_mode("HEAD")
        page.evaluate("window.pad.axes = [0, -1, 1, 0]")
        operator.moved("pan > 3")
        operator.wait("parseFloat(document.querySelector('#advance').textContent) > 1")
        page.evaluate("window.pad.axes = [0, 0, 0, 0]; window.pad.buttons[3].pressed = true")
        operator.in_mode("HOLD")


@pytest.mark.whole
def test_a_session_is_recorded_and_replayed(browser, address):
    with operating(browser, address) as operator:
        page = operator.take().page
        page.click("#record")
        page.wait_for_selector("#record[aria-pressed=true]")
        operator.enter("1", "HEAD")
        count = int(operator.state("pictures"))
        operator.wait(f"Number(document.body.dataset.pictures) > {count + 20}")
        page.click("#record")
        page.wait_for_selector("#notice:has-text('Recorded as')")
        page.click("#menu")
        page.keyboard.press("t")  # has no effect while the help is open
        page.wait_for_selector("#recordings a")
        count = int(operator.state("pictures"))
        operator.wait(f"Number(document.body.dataset.pictures) > {count + 3}")
        assert operator.state("pilot") == "yes"
        page.click("#recordings a")
        operator.wait("document.querySelector('#mode').textContent.startsWith('REPLAY')")
        operator.in_mode("HEAD")
        assert page.is_disabled("#take")


@pytest.mark.whole
def test_the_pages_keep_to_their_own_policy(browser, address):
    with operating(browser, address, bypass_csp=False) as operator:
        operator.page.wait_for_selector("body[data-mode=HOLD]")
        operator.page.click("text=Lab")
        operator.page.wait_for_selector("#browse")
        operator.state = lambda name: "no"


def test_a_browser_without_the_key_gets_an_instruction(browser, address):
    context = browser.new_context()
    page = context.new_page()
    page.goto(address.split("?")[0])
    assert "open the address that the server printed" in page.inner_text("body")
    context.close()


@pytest.mark.whole
def test_a_hint_of_the_search_does_not_take_the_place_of_why_the_head_holds(browser):
    state = {
        "type": "state", "seq": 1, "t": 1.0, "mode": "HOLD", "reason": "The pose is lost.",
        "command": [0, 0], "angle": [0, 0], "place": [0, 0], "rates": [0, 0], "current": [0, 0],
        "temperature": [20, 20], "memory": [[], []], "wire": [0, 0], "trouble": "",
        "clutch": False, "received": None, "late": 0, "safe_at": 0, "target": None,
        "centred": False, "focus": "", "scan": None, "spots": [],
    }  # fmt: skip
    controls = {"type": "controls", "you": 1, "pilot": 1, "grant": 7, "viewers": 1}
    found = {"type": "found", "seq": 0, "t": 1.0, "count": 0, "what": "found"}
    lines = []

    def served(route):
        name = route.request.url.partition("//")[2].partition("/")[2] or "index.html"
        file = STATIC / name
        route.fulfill(path=file) if file.is_file() else route.fulfill(status=404)

    page = browser.new_page()
    try:
        page.route("**/*", served)
        page.route_web_socket("**/ws", lambda line: lines.append(line))
        page.goto("http://console.test/")
        page.wait_for_function("document.querySelector('#take')")
        while not lines:
            page.wait_for_timeout(20)
        page.evaluate(
            "window.shown = [];"
            "new MutationObserver(() => shown.push(document.querySelector('#notice').textContent))"
            ".observe(document.querySelector('#notice'), {childList: true})"
        )
        for message in (controls, state, {**found, "verdict": "saturated"}):
            lines[0].send(json.dumps(message))
        page.wait_for_selector("#notice:has-text('The pose is lost.')")
        lines[0].send(json.dumps({"type": "notice", "seq": 3, "t": 1.0, "text": "last"}))
        page.wait_for_selector("#notice:has-text('last')")
        assert page.evaluate("window.shown") == ["The pose is lost.", "last"]
    finally:
        page.close()
