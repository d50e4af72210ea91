import pytest

from minorloop.errors import OutputError
from minorloop.report import Report, Table


def test_text_is_escaped():
    report = Report("<b>", "<script>")
    report.add("<i>", text="<u>", table=Table(("<a>",), [("<td>",)]), notes=["<p>"])
    html = report.html()
    for mark in ("<script>", "<b>", "<i>", "<u>", "<a>", "http:", "https:"):
        assert mark not in html


def test_a_page_that_exists_is_replaced_by_force_only(tmp_path):
    page = tmp_path / "page.html"
    page.write_text("old")
    with pytest.raises(OutputError, match="exists already"):
        Report("new", "page").write(page)
    Report("new", "page").write(page, force=True)
    assert "<h1>new</h1>" in page.read_text()
