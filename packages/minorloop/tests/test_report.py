import base64
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib.figure import Figure

from fixed_options import identify
from minorloop.errors import OutputError
from minorloop.report import Picture, Report, Table, identification_report


def test_is_one_file_that_opens_offline(tmp_path):
    u = np.random.default_rng(0).uniform(-1, 1, 200)
    result = identify(u, u**3, levels=4, holdout=0.2)
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
    return identify(u, u**3, levels=4, **options)


def pictures(html):
    """The drawings in a page, as text."""
    addresses = re.findall(r'<img src="([^"]*)"', html)
    head = "data:image/svg+xml;base64,"
    assert all(address.startswith(head) for address in addresses)
    return [base64.b64decode(address.removeprefix(head)).decode() for address in addresses]


def test_every_tag_is_closed():
    class Tags(HTMLParser):
        def __init__(self):
            super().__init__()
            self.open = []

        def handle_starttag(self, tag, attributes):
            if tag not in ("meta", "img"):
                self.open.append(tag)

        def handle_endtag(self, tag):
            assert self.open.pop() == tag

    report = Report("a", "b")
    report.add("c", text=["d", "e"], table=Table(("f", "g"), [("h", "i")]), notes=["j"])
    report.add("k", pictures=[Picture(Figure(), "l")])
    tags = Tags()
    tags.feed(report.html())
    tags.close()
    assert tags.open == []


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
