import re

import numpy as np
import pytest

from minorloop.positioning import run_positioning
from minorloop.positioning_report import positioning_report


@pytest.fixture(scope="module")
def result():
    return run_positioning(3, 0.05)


@pytest.fixture(scope="module")
def page(result):
    return positioning_report(result)


@pytest.fixture(scope="module")
def html(page):
    return page.html()


def figures(page):
    return [picture.figure for section in page.sections for picture in section["pictures"]]


def test_redraws_the_figures_of_the_paper(page, html):
    named = re.findall(r"Figs? (\d+)(?:, (\d+))?", html)
    assert {int(number) for pair in named for number in pair if number} == {7, 8, 9, 11, 12, 13, 14}
    assert len(figures(page)) == html.count("<img ") == 4


def test_its_numbers_are_those_of_the_experiment(result, page, html):
    figures = result.summary
    assert f"{figures['rms_preisach']:.2f} 1/m rms" in page.summary
    for drive in (result.preisach, result.quadratic):
        assert f"<td>{drive.rms:.3f}</td><td>{drive.worst:.3f}</td>" in html
    for target, voltage in zip(result.targets, result.preisach.voltages, strict=True):
        assert f"<td>{target:.2f}</td><td>{voltage:.3f}</td>" in html
    assert "seed 3" in html
    assert "noise of 0.05 1/m" in html


def test_the_curves_are_the_measurements(result, page):
    staircase, model, drives, errors = figures(page)
    np.testing.assert_array_equal(staircase.axes[1].get_lines()[0].get_ydata(), result.staircase.y)
    np.testing.assert_array_equal(model.axes[0].get_lines()[1].get_ydata(), result.settled)
    voltages, curvatures = (axes.get_lines() for axes in drives.axes)
    np.testing.assert_array_equal(voltages[0].get_ydata()[:-1], result.preisach.voltages)
    np.testing.assert_array_equal(curvatures[2].get_ydata(), result.quadratic.record.y)
    achieved = errors.axes[0].get_lines()[1].get_ydata()
    np.testing.assert_array_equal(achieved, result.preisach.achieved)
    heights = [bar.get_height() for bar in errors.axes[1].patches]
    np.testing.assert_allclose(heights[:14], result.preisach.errors)
