"""The lab page in a real browser: what its user does and sees."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from minorloop.operators.preisach import Preisach
from minorloop.page.lab import STATIC
from page_rig import chromium, fits, opened, printed_address, shoot


@pytest.fixture(scope="module")
def browser():
    with chromium(STATIC / "lab.html") as found:
        yield found


@pytest.fixture(scope="module")
def address(browser, tmp_path_factory):
    with printed_address("lab", "--folder", str(tmp_path_factory.mktemp("lab"))) as found:
        yield found


def csv(folder, stuck=0):
    rng = np.random.default_rng(1)
    u = np.concatenate([0.5 + a * np.sin(np.linspace(0, 12.6, 400)) for a in (0.5, 0.35, 0.2, 0.4)])
    levels = np.linspace(0, 1, 9)
    weights = np.tril(rng.uniform(size=(8, 8)) ** 2)
    y = Preisach(levels, weights).simulate(u) + rng.normal(0, 0.02, u.size)
    y[400 : 400 + stuck] = y[400]
    file = folder / f"staircase-{stuck}.csv"
    columns = np.column_stack([0.01 * np.arange(u.size), u, y])
    header = "time [s],voltage [V],length [um]"
    np.savetxt(file, columns, delimiter=",", header=header, comments="")
    return file


def test_a_csv_becomes_a_model_and_inputs(browser, address, tmp_path):
    with opened(browser, address) as (page, _):
        assert page.locator("nav").count() == 0  # there is no other page
        page.set_input_files("#file", csv(tmp_path))
        page.wait_for_selector("#setup:not([hidden])")
        assert page.input_value("#input") == "voltage [V]"
        assert page.input_value("#output") == "length [um]"
        page.click("#more summary")
        assert page.input_value("#time") == "time [s]"
        page.fill("#levels", "12")
        page.fill("#skip", "4")
        page.fill("#last", "1500")
        page.select_option("#slope", "false")
        page.click("#identify")
        page.wait_for_selector("#result:not([hidden])")
        scores = page.inner_text("#scores")
        assert re.search(r"error on held-out data\s+\d", scores)
        assert re.search(r"rows skipped\s+4\b", scores)
        assert "Chosen structure" in page.inner_text("#chosen")
        for value in ("900", "300", "600"):
            page.fill("#slider", value)
            page.wait_for_function("document.querySelector('#slider-output').textContent !== '–'")
        page.click("#invert")
        page.wait_for_selector("#sequence tbody tr:nth-child(5)")
        page.wait_for_selector("#get-report:not([hidden])")
        with page.expect_download() as waiting:
            page.click("#get-model")
        assert json.loads(Path(waiting.value.path()).read_text())["model"]
        page.fill("#targets", "1, two")
        page.click("#invert")
        page.wait_for_selector("#trouble:has-text('“two” is not a number')")
        page.fill("#targets", "1e9")
        page.click("#invert")
        page.wait_for_selector("#trouble:has-text('beyond what the model reaches')")
        page.fill("#targets", page.evaluate("'-1, 1, 0.5'"))
        page.click("#invert")
        page.wait_for_selector("#trouble", state="hidden")
        assert page.locator("#warnings li").count() == 0
        assert fits(page)
        shoot(page, "lab", whole=True)
        page.set_input_files("#file", csv(tmp_path, stuck=400))
        page.wait_for_selector("#drop-title:has-text('staircase-400.csv: 1600 rows')")
        page.click("#identify")
        page.wait_for_selector("#advice li:has-text('the output is stuck')")
        page.click("#invert")
        page.wait_for_selector("#warnings li:has-text('the output is stuck')")
        page.set_viewport_size({"width": 390, "height": 844})
        page.wait_for_function("document.documentElement.scrollWidth <= window.innerWidth")
