import base64
import re
from html.parser import HTMLParser
from xml.etree import ElementTree

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


def test_equal_figures_give_equal_bytes():
    figure = Figure()
    figure.subplots().plot([0, 1])
    assert Picture(figure, "x").address == Picture(figure, "x").address


def an_identification(**options):
    u = np.random.default_rng(0).uniform(-1, 1, 200)
    return identify(u, u**3, levels=4, **options)


def pictures(html):
    """The drawings in a page, as text."""
    addresses = re.findall(r'<img src="([^"]*)"', html)
    head = "data:image/svg+xml;base64,"
    assert all(address.startswith(head) for address in addresses)
    return [base64.b64decode(address.removeprefix(head)).decode() for address in addresses]


def test_has_no_external_links():
    html = identification_report(
        an_identification(), source="a.csv", input_label="u", output_label="y"
    ).html()
    assert not re.search(r"https?://|<script|<link|@import|url\(", html)
    (drawing,) = pictures(html)
    addresses = re.findall(r"https?://[^\s\"'<>]+", drawing)
    assert all(address.startswith("http://www.w3.org/") for address in addresses)
    ElementTree.fromstring(drawing)


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


@pytest.mark.parametrize("label", ["変位 [メートル]", r"$\foo$ [$]", "a < b & c", "x$_y$"])
def test_labels_do_not_change(label):
    html = identification_report(
        an_identification(), source="a.csv", input_label=label, output_label=label
    ).html()
    (drawing,) = pictures(html)
    shown = "".join(ElementTree.fromstring(drawing).itertext())
    assert label in shown


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


def test_a_column_of_sentences_begins_at_the_left():
    table = Table(("a", "b"), [("1", "x" * 40), ("2", "y")])
    assert table.sentences == [False, True]
    report = Report("t", "s")
    report.add("h", table=table)
    page = report.html()
    assert '<td class="sentence">y</td>' in page
    assert "<td>2</td>" in page
    assert Table(("a", "b"), []).sentences == [False, False]
