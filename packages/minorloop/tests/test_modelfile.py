import dataclasses
import json
from datetime import datetime, timedelta, timezone

import msgspec
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import minorloop
from minorloop import (
    GeneralisedPrandtlIshlinskii,
    ModelFileError,
    OutputError,
    ParameterError,
    Polynomial,
    PrandtlIshlinskii,
    Preisach,
    RecordError,
    RelayModel,
    load,
    save,
)
from minorloop._modelschema import KINDS, plain
from minorloop.dynamics.cascade import Cascade
from minorloop.dynamics.creep import Creep
from minorloop.dynamics.linear import Linear
from minorloop.dynamics.oscillator import Oscillator
from minorloop.identification.band_model import BandModel
from minorloop.modelfile import LARGEST, ModelWarning, Provenance, read
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.differential import BoucWen, Duhem
from minorloop.operators.generalised_prandtl_ishlinskii import DeadZones

LEVELS = [-1.0, 0.0, 0.5, 2.0]
TRIANGLE = [[0.1, 0.0, 0.0], [1 / 3, -0.0, 0.0], [5e-324, -1e300, np.pi]]
SMALL = [[0.1, 0.0, 0.0], [1 / 3, -0.2, 0.0], [5e-324, 0.2, np.pi]]
PLAYS = PrandtlIshlinskii([0.0, 0.1, 0.7], [1.0, 0.2, -0.3], 0.25)
MODELS = {
    "preisach": Preisach(LEVELS, TRIANGLE, 0.5, "unipolar", "reversible", 1 / 7),
    "relay": RelayModel(LEVELS[:3], TRIANGLE, -0.5, "unipolar"),
    "prandtl-ishlinskii": PLAYS,
    "generalised-prandtl-ishlinskii": GeneralisedPrandtlIshlinskii(
        PLAYS, DeadZones([-1.0, 0.0, 2.0], [0.1, 1.0, -0.5]), 3.0
    ),
    "polynomial": Polynomial([0.1, 0.2, 1 / 3], -2.0, 3.0),
    "cascade": Cascade(
        PLAYS,
        Linear([0.1], [1.0, 1 / 3, 0.1], None, 0.7),
        "operator",
        Creep([0.1, 3.0], [1 / 3, 0.1], 0.5, 0.1),
        1 / 7,
        Linear([1 / 3], [1.0, 0.1]),
    ),
    "linear": Linear([0.1, 1 / 7], [1.0, -1 / 3], 0.1, 0.3),
    "after-effect": AfterEffect(Preisach(LEVELS, TRIANGLE), times=[0.1, 3.0], creep=[SMALL, SMALL]),
    "oscillator": Oscillator(1 / 3, 0.1, [1 / 7, 3.0], Duhem(LEVELS, LEVELS, LEVELS[::-1])),
}
GIVEN = {"created": "2026-01-31T12:00:00Z", "minorloop": "0.1.0"}

finite = st.floats(allow_nan=False, allow_infinity=False)
kinds = pytest.mark.parametrize("kind", MODELS)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "model.json"


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    return tmp_path_factory.mktemp("models") / "model.json"


@pytest.fixture
def content(path):
    """A valid file as an object, to be spoilt."""
    save(MODELS["preisach"], path, provenance=GIVEN)
    return json.loads(path.read_text())


def same(one, other):
    """Whether models agree in every bit."""
    return type(one) is type(other) and repr(plain(one)) == repr(plain(other))


@pytest.mark.parametrize(
    "model",
    [
        *MODELS.values(),
        Oscillator(1.0, 0.1, 2.0, BoucWen(1 / 3, 0.1, -0.2, 1.5)),
        Oscillator(1.0, 0.1, 2.0, PLAYS),
        dataclasses.replace(MODELS["cascade"], ahead=None, first="linear"),
    ],
)
def test_loads_what_was_saved(model, path):
    save(model, path)
    assert same(load(path), model)
    assert read(path).kind == KINDS[type(model)]
    assert ('"ahead"' in path.read_text()) == (getattr(model, "ahead", None) is not None)


def test_a_file_with_a_model_of_another_class_is_refused(path):
    minorloop.save(minorloop.PrandtlIshlinskii([0.0], [1.0]), path)
    assert minorloop.load(path, minorloop.PrandtlIshlinskii) == minorloop.load(path)
    with pytest.raises(ModelFileError, match="has a PrandtlIshlinskii, not a Preisach; load it as"):
        minorloop.load(path, minorloop.Preisach)


def test_a_model_without_an_operator_on_its_input_is_refused_where_one_is_needed(path):
    save(MODELS["linear"], path)
    with pytest.raises(ModelFileError, match=r"a model of kind 'linear'.*identify --save"):
        _ = read(path).operator


def test_every_kind_is_tested():
    own = {of: kind for of, kind in KINDS.items() if of.__module__.startswith("minorloop.")}
    assert {type(model): kind for kind, model in MODELS.items()} == own


def test_provenance_that_is_given_is_kept(path, tmp_path):
    noon = datetime(2020, 6, 1, 12, tzinfo=timezone(timedelta(hours=2)))
    save(PLAYS, path, provenance={"created": noon, "minorloop": "0.0.1"})
    found = read(path).provenance
    assert (found.created, found.minorloop) == (noon, "0.0.1")
    assert "2020-06-01T10:00:00Z" in path.read_text()
    save(PLAYS, tmp_path / "again.json", provenance=found)
    assert (tmp_path / "again.json").read_bytes() == path.read_bytes()


@pytest.mark.parametrize(
    ("model", "options", "message"),
    [
        (PLAYS, {"provenance": {"author": "me"}}, "unknown field `author`"),
        (PLAYS, {"provenance": {"scores": {"nrmse": np.nan}}}, "score nrmse is nan"),
        (PLAYS, {"lag": -1}, "`int` >= 0 - at `lag`"),
        (PLAYS, {"input": "\udcff"}, "surrogates"),
        ({}, {}, "cannot hold a dict; give one of Preisach, Relay"),
    ],
)
def test_refuses_to_write_what_it_could_not_read(model, options, message, path):
    with pytest.raises(ParameterError, match=message):
        save(model, path, **options)
    assert not path.exists()
    with pytest.raises(RecordError, match=r"model\.json cannot be read: No such file"):
        Provenance.of(path)


def test_replaces_a_file_only_when_forced(path):
    path.write_text("precious")
    with pytest.raises(OutputError, match="exists already"):
        save(PLAYS, path)
    assert path.read_text() == "precious"
    save(PLAYS, path, force=True)
    assert same(load(path), PLAYS)


def spoil(content, keys, value):
    *way, last = keys
    for key in way:
        content = content[key]
    if value is None:
        del content[last]
    else:
        content[last] = value


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (["format"], "other", "is not a model file"),
        (["version"], 5, "format version 5, and this minorloop reads up to 4; install a newer"),
        (["version"], 2, "its keys need version 1, and it has 2"),
        (["warnings"], [], "at `warnings`"),
        (["model", "kind"], "bouc-wen", "'bouc-wen' - at `model.kind`; kinds are preisach, relay"),
        (["model", "levels"], [0.0, 1.0, 1.0, 2.0], "not strictly increasing"),
        (["model", "levels"], [0.0, 1.0], "weights have 3 rows; the levels need 1"),
        (["model", "weights", 1], [1.0], "row 1 of weights has 1 numbers; it needs 2"),
    ],
)
def test_refuses_a_file_that_is_inconsistent(keys, value, message, content, path):
    spoil(content, keys, value)
    path.write_text(json.dumps(content))
    with pytest.raises(ModelFileError, match=message):
        load(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "damaged, or is not JSON"),
        (b"\x80\x04\x95", "is not a model file"),
        (b'{"format": "\xff"}', "damaged, or is not JSON"),
        (b'{"a": ' * 100_000, "damaged, or is not JSON"),
    ],
)
def test_refuses_other_files(text, message, path):
    path.write_bytes(text)
    with pytest.raises(ModelFileError, match=message):
        load(path)


def test_refuses_paths_that_are_not_files(tmp_path, path):
    with pytest.raises(ModelFileError, match="there is no file"):
        load(path)
    with pytest.raises(ModelFileError, match="is not a file"):
        load(tmp_path)
    with pytest.raises(ModelFileError, match="is not a file"):
        load("/dev/zero")
    with pytest.raises(ModelFileError, match="cannot be the name of a file"):
        load("a\0b")


def test_refuses_a_file_that_is_too_large(path):
    with open(path, "wb") as file:
        file.truncate(LARGEST + 1)
    with pytest.raises(
        ModelFileError, match=f"{LARGEST + 1} bytes, a model file at most {LARGEST}"
    ):
        load(path)


def read_or_refused(path, data):
    """Whether the file reads; what reads has to be a model that can be saved again."""
    path.write_bytes(data)
    try:
        model = read(path).model
    except ModelFileError:
        return False
    save(model, path, force=True)
    assert same(read(path).model, model)
    return True


@pytest.fixture(scope="module")
def valid(scratch):
    """The bytes of a valid file of each kind."""
    texts = {}
    for kind, model in MODELS.items():
        save(model, scratch, provenance={**GIVEN, "scores": {"nrmse": 0.1}}, force=True)
        texts[kind] = scratch.read_bytes()
    return texts


@kinds
def test_flipping_a_bit_gives_a_model_or_a_refusal(kind, valid, scratch):
    outcomes = {
        read_or_refused(scratch, valid[kind][:i] + bytes([byte ^ 1]) + valid[kind][i + 1 :])
        for i, byte in list(enumerate(valid[kind]))[::7]
    }
    assert outcomes == {True, False}


@kinds
def test_a_truncated_file_is_refused(kind, valid, scratch):
    whole = valid[kind].rstrip()
    assert read_or_refused(scratch, whole)
    for length in range(0, len(whole), 7):
        assert not read_or_refused(scratch, whole[:length])


@given(
    json_like=st.recursive(
        st.none() | st.booleans() | st.integers() | finite | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
        ),
        max_leaves=8,
    )
)
@example(json_like={"format": "minorloop model", "version": 1})
def test_other_json_in_place_of_a_part_is_refused_or_read(json_like, valid, scratch):
    whole = json.loads(valid["preisach"])
    for key in whole:
        read_or_refused(scratch, json.dumps({**whole, key: json_like}).encode())
    for key in whole["model"]:
        model = {**whole["model"], key: json_like}
        read_or_refused(scratch, json.dumps({**whole, "model": model}).encode())


def test_warnings_are_kept_and_repeated_on_reading(path):
    model = MODELS["preisach"]
    save(model, path)
    assert json.loads(path.read_text())["version"] == 1
    assert read(path).warnings == ()
    said = ["the output is clipped", "x" * 3000, *["again"] * 30]
    save(model, path, warnings=said, force=True)
    assert json.loads(path.read_text())["version"] == 2
    assert read(path).warnings == ("the output is clipped", "x" * 1000, *["again"] * 18)
    with pytest.warns(ModelWarning, match="the output is clipped"):
        assert same(load(path), model)
    with pytest.raises(ParameterError, match="warnings"):
        save(model, path, warnings=["a\nb"], force=True)


@pytest.mark.parametrize("letter", ["\n", "\x1b", "\x7f", "\x9b", "\u2028", "\u202e"])
def test_refuses_names_with_control_characters(letter, tmp_path):
    path, model = tmp_path / "m.json", MODELS["preisach"]
    with pytest.raises(ParameterError, match="cannot be printed"):
        save(model, path, input=f"u{letter}x")
    with pytest.raises(ParameterError, match="cannot be printed"):
        save(model, path, provenance={"data": f"u{letter}x.csv"})
    save(
        model, path, input="name-u [unit-u]", provenance={"data": "file-u", "scores": {"sc-u": 1.0}}
    )
    text = path.read_text()
    for word in ("name-u", "unit-u", "file-u", "sc-u"):
        path.write_text(text.replace(word, json.dumps(f"{word}{letter}")[1:-1]))
        with pytest.raises(ModelFileError, match="cannot be printed"):
            read(path)


@pytest.mark.parametrize("unit", [b"[", b'{"a":', b"[],", b"1,", b'"a":1,'])
def test_files_full_of_marks_are_refused_before_decoding(unit, tmp_path, monkeypatch):
    monkeypatch.setattr(msgspec.json, "decode", None)
    path = tmp_path / "m.json"
    path.write_bytes(b'{"format": "minorloop model", "version": 1, "x": ' + unit * 3_000_000)
    with pytest.raises(ModelFileError, match=r"of the mark .*, a model file at most \d+"):
        read(path)


def test_an_identification_with_an_interval_is_saved_with_its_lag_in_seconds(tmp_path):
    u = np.sin(np.arange(60) / 4)
    record = minorloop.Record(u, u, 0.01 * np.arange(60))
    law = minorloop.Plane(3, slope=False, lag=2)
    found = minorloop.identify(record, law, prior=minorloop.Smooth())
    minorloop.save(found, tmp_path / "m.json")
    assert read(tmp_path / "m.json").lag_seconds == pytest.approx(0.02)
    with pytest.warns(ModelWarning, match="a lag of 2 samples, which the loaded model leaves out"):
        load(tmp_path / "m.json")


@pytest.fixture(scope="module")
def with_bands(tmp_path_factory):
    """The text of a file with bands."""
    u = np.random.default_rng(1000).uniform(-1, 1, 200)
    noise = 0.01 * np.random.default_rng(1001).normal(size=200)
    path = tmp_path_factory.mktemp("bands") / "m.json"
    save(minorloop.identify(u, np.abs(u) + noise, minorloop.Plane(4)), path)
    return path.read_text()


def bands_of(path):
    known = read(path)
    return BandModel.of_file(known.bands, known.model)


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (["levels"], [0.0, 0.0], "not strictly increasing"),
        (["levels"], [0.0, 1.0], "factors have 11 rows; the levels need 2"),
        (["factor", 1], [1.0], "row 1 of factors has 1 numbers; it needs 2"),
        (["error", "reached", 1], "2a", "text of 0 and 1"),
        (["error", "factors"], [1.0, -1.0, 0.0], "must be >= 0"),
    ],
)
def test_damaged_bands_are_refused(keys, value, message, with_bands, path):
    content = json.loads(with_bands)
    spoil(content["bands"], keys, value)
    path.write_text(json.dumps(content))
    with pytest.raises(ModelFileError, match=message):
        bands_of(path)
