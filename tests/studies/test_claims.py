from minorloop.studies.claims import Claim, claim_table, for_each, medians

FIGURES = {"a": {"b": 0.02}, "bad": False}


def test_verdicts():
    rows = claim_table(
        [
            Claim("small", "a.b", "-", most=0.03, percent=True),
            Claim("large", "a.b", "-", least=0.03),
            Claim("said", "a.b", "plot only"),
            Claim("diverged", "bad", "-"),
            Claim("must not", "bad", "-", most=0),
            Claim("must", "bad", "-", least=1),
        ],
        FIGURES,
    ).rows
    assert [row[-1] for row in rows] == ["met", "short", "reported", "reported", "met", "short"]
    assert rows[0][2:4] == ("2.00%", "<= 3.00%")
    assert rows[3][2] == "no"
    assert [row[3] for row in rows[3:]] == ["-", "no", "yes"]


def test_what_is_not_a_number_is_never_met():
    claims = [Claim("of none", "a", "-"), Claim("asked for", "a", "-", most=1.0)]
    rows = claim_table(claims, {"a": float("nan")}).rows
    assert [row[2] for row in rows] == ["none", "none"]
    assert [row[-1] for row in rows] == ["nothing to count", "short"]


def test_medians_over_specimens():
    runs = [{"x": value, "y": {"z": [value, 1]}, "any": value > 2} for value in (1, 3, 2)]
    assert medians(runs) == {"x": 2.0, "y": {"z": [2.0, 1.0]}, "any": True}


def test_one_specimen_needs_no_other_process():
    assert for_each(lambda seed: seed * 2, 1, 5, print) == [10]
