import pytest

from papers import benchmark, bouc_wen
from papers.claims import claim_table


@pytest.fixture(scope="module")
def study():
    """One specimen with a fourth of the samples and fewer plays, to save time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bouc_wen, "PERIOD", 2048)
        patch.setattr(bouc_wen, "NOISE", 4e-6)  # as much for the parameters as 8e-6 of them all
        patch.setattr(bouc_wen, "SWEEP", (30.0, 32.0, 12.0, 40.0))
        patch.setattr(benchmark, "PLAYS", 2)
        yield benchmark.run_study(1000)


@pytest.mark.usefixtures("without_pictures")
def test_the_report_has_our_rows_among_the_published(study):
    figures = study.figures()
    rows = benchmark.published_table(figures).rows
    errors = [float(row[1]) for row in rows]
    assert errors == sorted(errors, reverse=True)
    assert {row[3] for row in rows} > {"ours", "Forgione and Piga, 2021"}
    html = benchmark.STUDY.report(study, figures, [figures]).html()
    assert html.count("<img") == 3
    assert "The law that was found" in html
    assert len(claim_table(benchmark.STUDY.claims, figures).rows) == len(benchmark.STUDY.claims)
