"""FHIR, our JSON schema and RO-Crate, each read by the library made for it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from skinlab.cli.main import cli
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import parse_program
from skinlab.exchange.codes import unit_of
from skinlab.exchange.fhir import _decimal, to_fhir
from skinlab.exchange.importing.reader import Imported
from skinlab.exchange.importing.session import Who, imported_session
from skinlab.exchange.parameters import SCHEMA
from skinlab.exchange.ro_crate import ro_crate
from skinlab.inference.identify import Identifier
from skinlab.mechanics.effects import all_effects
from skinlab.recording.session import read_session, write_session
from skinlab.tables.store import shipped_table

PROGRAM = parse_program("ramp:100@20")


@pytest.fixture(scope="module")
def session_path(tmp_path_factory):
    identifier = Identifier(shipped_table())
    time_s = np.arange(51) * 0.1
    curves = [
        Curve(f"c{k}", Setup(6.0, 1.0, PROGRAM), time_s, 20 * time_s, 0.05 * k + 0.08 * time_s)
        for k in (0, 1)
    ]
    curves[0] = Curve(
        "c0", Setup(6.0, 1.0, PROGRAM), time_s, 20 * time_s, 0.55 * np.tanh(0.4 * time_s)
    )
    results = [identifier(curve) for curve in curves]
    imported = [Imported(c, f"{c.name}.csv", "0" * 64, ()) for c in curves]
    who = Who("P-017", "forearm <left>", "op1", lambda: 0.0, lambda: 1.7e9)
    path = tmp_path_factory.mktemp("session") / "visit.h5"
    write_session(path, imported_session(imported, results, identifier, who))
    return path


def exported(path, kind, folder):
    done = CliRunner().invoke(cli, ["export", str(path), "--to", kind, str(folder)])
    assert done.exit_code == 0, done.output
    return json.loads(next(folder.iterdir()).read_text(encoding="utf-8"))


def test_a_bundle_is_fhir_and_holds_the_curve_and_its_parameters(session_path, tmp_path):
    text = exported(session_path, "fhir", tmp_path / "f")
    from fhir.resources.R4B.bundle import Bundle  # slow to import

    bundle = Bundle.model_validate(text)
    codes, *observations = [e.resource for e in bundle.entry]
    assert codes.get_resource_type() == "CodeSystem"
    known = {c.code for c in codes.concept}
    stored = read_session(session_path)
    assert len(observations) == len(stored.curves)
    for observation, curve, result in zip(observations, stored.curves, stored.results, strict=True):
        assert observation.subject.identifier.value == "P-017"
        parts = {c.code.coding[0].code: c for c in observation.component}
        assert set(parts) <= known
        for name in ("pressure", "deflection", "time"):
            data = parts[name].valueSampledData
            assert float(data.period) == pytest.approx(100.0)
            read = np.array([float(v) for v in data.data.split()])
            wanted = {
                "time": curve.time_s,
                "pressure": curve.pressure_mbar,
                "deflection": curve.deflection_mm,
            }[name]
            assert read == pytest.approx(wanted, abs=1e-9)
        assert parts["deflection"].valueSampledData.origin.code == "mm"
        for name, value in (result["parameters"] or {}).items():
            quantity = parts[name].valueQuantity
            assert float(quantity.value) == pytest.approx(value["value"])
            assert quantity.system == "http://unitsofmeasure.org"
            interval = parts[name].extension[0].valueRange
            assert float(interval.low.value) == pytest.approx(value["low"])
    again = exported(session_path, "fhir", tmp_path / "g")
    assert again == text


@pytest.mark.long
def test_parameters_keep_their_schema_and_say_what_they_are_of(session_path, tmp_path):
    import jsonschema  # takes seconds, which every process of the tests would pay

    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    document = exported(session_path, "parameters", tmp_path / "p")
    jsonschema.validate(document, SCHEMA)
    first = document["curves"][0]
    assert first["law"] == "extended_neo_hookean"
    assert first["table"]["hash"] == shipped_table().content_hash
    assert first["setup"]["program"] == "ramp:100@20"
    assert first["parameters"]["X1_MPa"]["unit"] == "MPa"
    broken = json.loads(json.dumps(document))
    del broken["curves"][0]["table"]
    with pytest.raises(jsonschema.ValidationError, match="table"):
        jsonschema.validate(broken, SCHEMA)


def test_each_curve_says_which_sessions_file_it_is_of(session_path, tmp_path):
    """Bundles of several sessions could be told apart by hashes alone."""
    observation = exported(session_path, "fhir", tmp_path / "f")["entry"][-1]["resource"]
    extension = {"url": "urn:x-skinlab:session-file", "valueString": "visit.h5"}
    assert observation["extension"] == [extension]
    (entry, *_) = exported(session_path, "parameters", tmp_path / "p")["curves"]
    assert entry["session_file"] == "visit.h5"


def test_units_of_effects_are_ucum():
    """UCUM has no µm; a bundle with a drift was refused by who checks units."""
    units = {unit_of(f"{one.name}.{p.name}") for one in all_effects() for p in one.parameters}
    assert {"um", "um/s", "mbar", "1"} < units
    assert all(unit.isascii() for unit in units)


def test_a_bundle_says_by_which_model_it_was_identified(session_path):
    """The X1 of a stretched skin was told as one of the law alone."""
    session = read_session(session_path)
    settings = session.meta["identification"]
    told = []
    for model in (None, '[model]\nname = "stretched"\n'):
        meta = {**session.meta, "identification": {**settings, "model": model}}
        text = to_fhir(replace(session, meta=meta))["fhir.json"]
        told.append(json.loads(text)["entry"][-1]["resource"]["note"][-1]["text"])
    assert told[0].startswith("identified by the law alone with auto, seed 0, ")
    assert told[1].startswith("identified by the model 'stretched' with auto, seed 0, ")


def test_a_zero_has_no_sign_in_sampled_data():
    assert [_decimal(v) for v in (-3.6e-19, -0.25, 0.0)] == ["0", "-0.25", "0"]


def test_the_day_of_an_import_is_not_told_as_that_of_the_measurement(session_path, tmp_path):
    observation = exported(session_path, "fhir", tmp_path / "f")["entry"][-1]["resource"]
    assert "effectiveDateTime" not in observation
    entry = exported(session_path, "parameters", tmp_path / "p")["curves"][0]
    assert entry["measured_utc"] is None


def test_the_schema_in_the_docs_is_the_one_of_the_program():
    from pathlib import Path

    docs = Path(__file__).parents[3] / "docs" / "parameters.schema.json"
    assert json.loads(docs.read_text(encoding="utf-8")) == SCHEMA


def test_a_crate_is_read_by_the_library_of_ro_crate(tmp_path):
    (tmp_path / "curves.csv").write_text("file\n", encoding="utf-8")
    text = ro_crate(
        tmp_path,
        {"curves.csv": "a table"},
        name="a study",
        description="curves",
        date="2026-01-01T00:00:00+00:00",
        versions={"skinlab": "1"},
        licence="none",
    )
    (tmp_path / "ro-crate-metadata.json").write_text(text, encoding="utf-8")
    from rocrate.rocrate import ROCrate  # slow to import

    crate = ROCrate(tmp_path)
    assert crate.name == "a study"
    assert crate.license is not None
    file = crate.dereference("curves.csv")
    assert file["encodingFormat"] == "text/csv"
    assert len(file["sha256"]) == 64
    assert crate.dereference("#run")["instrument"]["softwareVersion"] == "1"
