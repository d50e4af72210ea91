import numpy as np
import pytest
from matplotlib.figure import Figure

from minorloop.errors import OutputError
from minorloop.identification import identify
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


def test_text_is_never_markup():
    report = Report("<b>", "<script>")
    report.add("<i>", text="<u>", table=Table(("<a>",), [("<td>",)]), notes=["<p>"])
    html = report.html()
    for mark in ("<script>", "<b>", "<i>", "<u>", "<a>"):
        assert mark not in html


def test_the_same_figure_gives_the_same_bytes():
    figure = Figure()
    figure.subplots().plot([0, 1])
    assert Picture(figure, "x").address == Picture(figure, "x").address
