import math

from papers.claims import Claim, cell, claim_table, claims_of

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
    assert [row[-1] for row in rows] == ["met", "not met", "reported", "reported", "met", "not met"]
    assert rows[0][2:4] == ("2.00%", "<= 3.00% (ours)")
    assert rows[3][2] == "no"
    assert [row[3] for row in rows[3:]] == ["-", "no (ours)", "yes (ours)"]


def test_what_is_not_a_number_is_never_met():
    claims = [Claim("of none", "a", "-"), Claim("asked for", "a", "-", most=1.0)]
    rows = claim_table(claims, {"a": float("nan")}).rows
    assert [row[2] for row in rows] == ["none", "none"]
    assert [row[-1] for row in rows] == ["nothing to count", "not met"]


def test_what_never_came_is_said_in_words():
    claim = Claim("settling", "a", "-", most=9.0)
    assert claim.row({"a": float("inf")})[2:] == ("not reached", "<= 9 (ours)", "not met")
    assert [cell(value, ".1f") for value in (float("inf"), float("nan"), 1.26)] == [
        "not reached",
        "none",
        "1.3",
    ]


def test_of_too_few_nothing_is_said():
    claim = Claim("cover", "cover", "-", 0.85, 0.95, percent=True, count="scans", enough=100)
    assert claim.row({"cover": 1.0, "scans": 6})[2:] == (
        "100.00% (of 6)", "85.00% to 95.00% (ours)", "too few"
    )  # fmt: skip
    assert claim.row({"cover": 1.0, "scans": 100})[-1] == "not met"
    spread = Claim("spread", "spread", "-", most=20.0, count="scans", enough=2)
    assert spread.row({"spread": float("nan"), "scans": 1})[-1] == "too few"


def test_rows_of_the_file_have_bounds_and_those_of_parts():
    claims = {claim.key: claim for claim in claims_of("inspection")}
    assert list(claims) == list(dict.fromkeys(claims))
    assert claims["depth.bias_um"] in claims_of("scans")
    recall = claims["cracks.recall_100um"]
    assert (recall.least, recall.most, recall.percent) == (0.95, math.inf, True)
    assert (recall.count, recall.enough, recall.bound) == ("cracks.scenes_100um", 20, "ours")
    assert [claims[f"reach.at_{t}_c"].what[-4:] for t in (20, 40)] == ["20 C", "40 C"]
    assert {claim.bound for claim in claims_of("head")} == {"ours", "the paper's"}
