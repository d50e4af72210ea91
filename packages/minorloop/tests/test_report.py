import numpy as np
import pytest

from fixed_options import Options, Plane, identify
from minorloop.errors import OutputError
from minorloop.lab.records import Record
from minorloop.report import Report, Table, identification_report


def test_is_one_file_that_opens_offline(tmp_path):
    u = np.random.default_rng(0).uniform(-1, 1, 200)
    result = identify(u, u**3, Plane(4), holdout=0.2)
    page = identification_report(
        result, source="a & b.csv", input_label="voltage [V]", output_label="length [um]"
    )
    page.write(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert "a &amp; b.csv" in text
    assert "length [um] against voltage [V]" in text
    assert "data:image/svg+xml;base64," in text
    assert 'src="http' not in text
    with pytest.raises(OutputError, match="exists already"):
        page.write(tmp_path / "report.html")


def test_text_is_escaped():
    report = Report("<b>", "<script>")
    report.add("<i>", text="<u>", table=Table(("<a>",), [("<td>",)]), notes=["<p>"])
    html = report.html()
    for mark in ("<script>", "<b>", "<i>", "<u>", "<a>"):
        assert mark not in html


def an_identification(**options):
    u = np.random.default_rng(0).uniform(-1, 1, 200)
    return Options.of({"levels": 4, **options}).identify(Record(u, u**3))


def test_states_what_was_held_out():
    for options, says in (
        ({}, "nothing was held out"),
        ({"holdout": 0.3}, "on held-out data"),
    ):
        result = an_identification(**options)
        page = identification_report(result, source="a.csv", input_label="u", output_label="y")
        assert says in page.summary
        assert f"{result.nrmse:.2%} of range on the {result.samples} samples" in page.summary
        assert page.sections[0]["notes"] == result.advice


def test_force_replaces_a_page(tmp_path):
    page = tmp_path / "page.html"
    page.write_text("old")
    Report("new", "page").write(page, force=True)
    assert "<h1>new</h1>" in page.read_text()
