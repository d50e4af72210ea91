"""An inspection keeps all at once, ends safe, and resumes from any line of its journal."""

import json
import math
from itertools import pairwise

import pytest

from minorloop.errors import InstrumentError, OutputError, ParameterError, RecordError, SafetyError
from minorloop_head.inspection import inspect_pipe as module
from minorloop_head.inspection.report import summary
from minorloop_head.procedures import inspection, probing
from scripted_inspection import hole


@pytest.mark.usefixtures("drawn")
def test_an_inspection_writes_findings_pictures_and_a_report(script):
    found = script.run(pipe="line 4, spool 12", least_wall=1.8e-3)
    assert (found.content["ended"], found.content["safe"], script.safe) == ("finished", True, True)
    assert script.taken[4:] == ["hole 1", "hole 2", "hole 2 again", "crack 1"]
    points = [(z, s, n) for z, s in ((0.02, 0.0), (0.02, 0.5), (0.022, 0.0)) for n in (0, 1)]
    assert script.made == [*points, "ring"]
    assert json.loads((script.folder / "findings.json").read_text()) == found.content
    pit, crack = found.findings
    assert (pit["kind"], pit["z [mm]"], pit["depth [mm]"]) == ("pit", 20.0, 0.5)
    assert (crack["depth [mm]"], crack["touched"], pit["touched"]) == (0.7, None, True)
    steps = [step["step"] for step in pit["steps"]]
    assert steps == ["touch", "scan", "measure", "scan", "measure again"]
    assert found.content["water above the axis [mm]"] == [4.0, 0.2]
    assert [row["why"] for row in found.content["unconfirmed"]] == ["not seen again"]
    names = {path.name for path in (script.folder / "pictures").iterdir()}
    assert {"hole 1.png", "hole 1 marked.jpg", "crack 1 marked.jpg", "view 4.png"} <= names
    table = (script.folder / "findings.csv").read_text().splitlines()
    assert [line.split(",")[:3] for line in table[1:]] == [
        ["1", "pit", "measured"], ["2", "crack", "measured"],
    ]  # fmt: skip
    assert [(row["grade"], row["accepted"]) for row in found.findings] == [("confirmed", False)] * 2
    assert [row["wall [mm]"] for row in found.findings] == [1.5, 1.3]
    page = found.report.read_text()
    assert "line 4, spool 12" in page
    assert summary(found.content) in page
    assert "2 of 2 depths known; the head is safe, as confirmed" in page
    assert "C-scan" in page
    assert found.seen is not None
    assert [each.picture.name for each in found.views][-1] == "crack 1"
    assert [each["what"] for each in script.journal()][:: len(script.journal()) - 1] == [
        "begin", "end",
    ]  # fmt: skip
    with pytest.raises(OutputError, match="is not empty"):
        script.run()


@pytest.mark.usefixtures("unreported")
def test_it_goes_on_from_any_line_with_the_same_findings(script):
    """The line after is cut, and the picture that comes before it is torn."""
    script.run()
    whole, lines, taken, made = script.content(), script.lines(), [*script.taken], [*script.made]
    for end in range(len(lines) - 1, 0, -2):
        done = [json.loads(line) for line in lines[:end]]
        views = {each["picture"][:-4] for each in done if each["what"] == "view"}
        points = sum(len(each["bursts"]) for each in done if each["what"] == "scan")
        script.rewrite([*lines[:end], lines[end][: len(lines[end]) // 2]])
        for name in {*taken} - views:
            (script.folder / f"pictures/{name}.png").write_bytes(b"torn")
        script.run(resume=True)
        assert script.content() == whole
        assert script.taken == [name for name in taken if name not in views]
        ringed = any(each["what"] == "ring" for each in done)
        assert script.made == made[points : -1 if ringed else None]
        again = script.journal()
        kinds = [each["what"] for each in again if each["what"] in ("begin", "resume", "end")]
        assert kinds == ["begin", "resume", "end"]
        assert all(each["t"] <= later["t"] for each, later in pairwise(again))


def ending(error):
    """End an inspection at its crack."""

    def before(rig, name):
        if name == "crack 1":
            raise error

    return before


@pytest.mark.usefixtures("unreported")
def test_a_view_that_could_not_be_used_is_taken_again_by_a_resume(script):
    """What it shows then is visited after what was visited before, under a number of its own."""
    script.probe, script.torn = False, {"view 1", "hole 2 again"}
    script.before = ending(KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        script.run()
    before = script.content()
    assert [row["verdict"] for row in before["not searched"]] == ["torn"]
    assert before["unusable"] == {"torn": 2}
    script.torn, script.before = set(), lambda rig, name: None
    script.shown["view 1"] = [hole(0.2, 21e-3, 9.9), *script.shown["view 1"]]
    after = script.run(resume=True).content
    assert script.taken == ["view 1", "hole 2 again", "hole 3", "hole 3 again", "crack 1"]
    assert (after["unusable"], after["not searched"]) == ({}, [])
    assert [row["kind"] for row in after["findings"]] == ["hole or pit", "crack"]
    assert after["findings"][0] == before["findings"][0]
    assert [row["seen in"] for row in after["unconfirmed"]] == [["view 3"], ["view 1"]]


@pytest.mark.usefixtures("unreported")
@pytest.mark.parametrize(
    ("reach", "failed"), [("", "failed: centre"), ("out of reach: ", "")], ids=["within", "beyond"]
)
def test_a_finding_says_that_its_centring_failed_unless_it_is_out_of_reach_also_after_a_resume(
    script, monkeypatch, reach, failed
):
    said = f"{reach}28.5 px from the middle of 640 by 480"

    def off(rig, *_, **__):
        rig.say("centre", said, succeeded=False)

    monkeypatch.setattr(inspection, "centre", off)
    script.probe = False
    content = script.run().content
    verdict = f"not scanned, but {failed}" if failed else "not scanned"
    assert [row["verdict"] for row in content["findings"]] == [verdict] * 2
    step = {"step": "centre", "outcome": said}
    assert content["findings"][0]["steps"] == [step | {"succeeded": False}]
    assert not content["findings"][0]["centred"]
    why = f"not seen again; {failed}" if failed else "not seen again"
    assert content["unconfirmed"][0]["why"] == why
    script.rewrite(script.lines()[:-1])
    assert script.run(resume=True).findings == content["findings"]


@pytest.mark.usefixtures("unreported")
def test_a_crack_of_one_view_without_an_echo_is_not_confirmed(script):
    script.crack_depth = type(script.crack_depth)("no floor echo")
    content = script.run().content
    assert [row["kind"] for row in content["findings"]] == ["pit"]
    whys = {row["kind"]: row["why"] for row in content["unconfirmed"]}
    assert whys["crack"].endswith("and no echo of its depth: no floor echo")


@pytest.mark.parametrize(
    "part",
    [
        "crack 1",
        *(
            pytest.param(part, marks=pytest.mark.whole)
            for part in ("map of the pipe", "water line")
        ),
    ],
)
def test_it_ends_with_a_report_whatever_part_of_it_could_not_be_computed(script, monkeypatch, part):
    def fails(*_):
        raise ValueError("need at least one array")

    if part == "crack 1":
        script.before = lambda rig, name: name == part and fails()
    else:
        where = (module, "seen_wall") if "map" in part else (probing, "ring_sweep")
        monkeypatch.setattr(*where, fails)
    content = script.run().content
    assert (content["ended"], script.safe) == ("finished", True)
    assert content["not done"] == [{"step": part, "why": "need at least one array"}]
    kinds = [row["kind"] for row in content["findings"]]
    assert kinds == ["pit"] if part == "crack 1" else ["pit", "crack"]
    page = (script.folder / "report.html").read_text()
    assert "Not done, and why" in page
    assert "need at least one array" in page
    monkeypatch.setattr(module, "written", lambda *given: None)  # a second report says the same
    script.rewrite(script.lines()[:-1])
    assert script.run(resume=True).content["not done"] == content["not done"]


@pytest.mark.parametrize("least", [-1e-3, 0.0, math.nan, 1.0])
def test_a_wall_that_cannot_be_left_is_refused_before_anything_moves(script, least):
    with pytest.raises(ParameterError, match="the least remaining wall is"):
        script.run(least_wall=least)
    assert not script.folder.exists()


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (InstrumentError("the camera gives no picture"), "the head is safe, as confirmed"),
        (SafetyError("the source may still be on"), "did NOT confirm that it is safe"),
        (KeyboardInterrupt(), "interrupted; 1 of 1 depths known"),
    ],
)
def test_one_that_ends_early_keeps_what_it_found(script, error, said):
    script.before = ending(error)
    with pytest.raises(type(error)) as ended:
        script.run()
    assert said in ended.value.__notes__[-1]
    assert ended.value.__notes__[-1].endswith(f"; kept in {script.folder}")
    assert script.safe
    assert len((script.folder / "findings.csv").read_text().splitlines()) == 2
    assert script.journal()[-1]["safe"] == (not isinstance(error, SafetyError))
    assert (script.folder / "report.html").exists()


@pytest.mark.parametrize("when", ["crack 1", "report"])
def test_a_full_disk_ends_it_in_one_sentence_to_be_resumed(script, full_disk, monkeypatch, when):
    if when == "report":
        monkeypatch.setattr(
            "minorloop_head.inspection.inspect_pipe.lens_words", lambda _: full_disk()
        )
    else:
        script.before = lambda rig, name: name == when and (full_disk(), rig.say("pick", "phi"))
    with pytest.raises(OutputError, match="No space left on device; free some space") as ended:
        script.run()
    assert "--resume goes on from there" in ended.value.__notes__[-1]
    assert script.safe
    assert script.journal()[-1]["what"] in ("step", "view", "ring")
    assert (script.folder / "pictures/hole 1.png").exists()


def changed(lines, what, names, value):
    """Lines of which the first of a kind has another value at the end of the way of names."""
    number = next(
        n
        for n, line in enumerate(lines)
        if line["what"] == what and names[0] in line and line[names[0]]
    )
    within = lines[number]
    for name in names[:-1]:
        within = within[name]
    within[names[-1]] = value
    return number + 1


IMPOSSIBLE = [
    ("view", ("pose", "pan [deg]"), 400.0, "has 400.0 as 'pan [deg]', which must be at most 180"),
    ("view", ("seen", 0, "rim", 1), [9.0, 0.0], "has [9.0, 0.0] as 'rim', which must be -6.283"),
    ("view", ("picture",), "../../other.png", "has '../../other.png' as 'picture', which must"),
    ("view", ("sight",), None, "has None as 'sight', which must be object"),
    ("scan", ("point",), True, "has True as 'point', which must be int"),
    ("scan", ("bursts", 0, "shots"), [16, 8], "has (16, 8) as 'shots', which must be no more used"),
    ("scan", ("bursts", 0, "trace"), "AAA", "is incomplete: Invalid base64 encoded string"),
    ("ring", ("profile", "spots"), [[0.1, 11.0]], "has [0.1, 11.0] as 'spots'"),
]


@pytest.mark.usefixtures("unreported")
def test_a_line_with_an_impossible_value_is_refused(script):
    script.run()
    whole = script.lines()[:-1]
    for what, names, value, words in IMPOSSIBLE:
        lines = [json.loads(line) for line in whole]
        number = changed(lines, what, names, value)
        script.rewrite(lines)
        with pytest.raises(RecordError) as refused:
            script.run(resume=True)
        assert f"line {number} of {script.folder}/journal.jsonl {words}" in str(refused.value)
        assert "delete this line and all lines after it" in str(refused.value)


@pytest.mark.usefixtures("unreported")
def test_one_that_cannot_be_resumed_is_refused(script):
    with pytest.raises(
        RecordError, match=r"there is no folder .*; give the folder of the interrupted inspection"
    ):
        script.run(resume=True)
    script.run()
    with pytest.raises(ParameterError, match=r"the inspection in .* is finished; give another"):
        script.run(resume=True)
    lines = script.journal()[:-1]
    script.rewrite(lines)
    with pytest.raises(ParameterError, match=r"advances .mm..1 was 5.0 and is 4.0 now"):
        script.run((0.0, 4e-3), resume=True)
    burst = next(line["bursts"] for line in lines if line["what"] == "scan")
    burst *= 2
    script.rewrite(lines)
    with pytest.raises(RecordError, match=r"has 'a trace again' as 'trace', which must be another"):
        script.run(resume=True)
    script.rewrite(["nonsense\n"])
    with pytest.raises(RecordError, match="is not the journal of an inspection"):
        script.run(resume=True)
