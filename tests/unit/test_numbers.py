"""`1_0` is no number, wherever one is read from text: Python takes it for 10."""

from __future__ import annotations

import math

import click
import pytest

from drivers.numbers import number_in, whole_in
from skinlab.acquisition.measurement_request import complaint
from skinlab.acquisition.protocol import condition_complaint
from skinlab.cli.main import cli, run
from skinlab.curves.campaign import read_campaign
from skinlab.curves.csv import read_curve
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.inference.methods import METHODS
from skinlab.studies.facts import checked


def test_what_is_a_number():
    assert (number_in(" 1e1 "), whole_in("10")) == (10.0, 10)
    assert math.isnan(number_in("nan"))
    for text in ("1_0", "1_0.5", "1e1_0", "", "ten"):
        for read in (number_in, whole_in):
            with pytest.raises(ValueError, match=r"."):
                read(text)


def commands(group, context):
    for name in group.list_commands(context):
        _, command, _ = group.resolve_command(context, [name])
        yield command
        if isinstance(command, click.Group):
            yield from commands(command, click.Context(command, parent=context))


def test_no_option_takes_it():
    tried = 0
    for command in commands(cli, click.Context(cli)):
        for option in command.params:
            if isinstance(option.type, type(click.FLOAT) | type(click.INT)):
                tried += 1
                assert option.type.convert("1", option, None) == 1
                with pytest.raises(click.BadParameter, match="'1_0' is not a valid"):
                    option.type.convert("1_0", option, None)
    assert tried > 30
    assert click.FLOAT.convert("1_0", None, None) == 10.0  # that of others stays as it is


def test_the_command_line_says_so_in_one_sentence(capsys):
    assert run(["identify", "c.csv", "--aperture-mm", "6_0", "--thickness-mm", "1"]) == 2
    said = capsys.readouterr().err
    assert said.endswith("Error: Invalid value for '--aperture-mm': '6_0' is not a valid float.\n")


def test_options_of_methods_do_not_take_it():
    for method in METHODS.all():
        for option in method.options:
            if not isinstance(option.default, str):
                with pytest.raises(ValueError, match="'1_0' is not"):
                    option.parse("1_0")


def test_files_and_programs_do_not_take_it(tmp_path):
    path = tmp_path / "c.csv"
    path.write_text("time_s,pressure_mbar,deflection_mm\n0,0,0\n1,1_0,0\n")
    with pytest.raises(InputError, match="line 3: pressure_mbar is '1_0', expected a number"):
        read_curve(path, Setup(6, 1))
    with pytest.raises(InputError, match="was not understood"):
        parse_program("ramp:1_00@20")
    for name in ("noise_um", "cycle"):
        with pytest.raises(InputError, match=f"{name} is '1_0', expected a"):
            checked({name: "1_0"}, "P1")
    with pytest.raises(InputError, match="P1: noise_um is 0, expected more than 0 and less than"):
        checked({"noise_um": 0}, "P1")  # as campaign.toml refuses it: it was "not stated"
    assert checked({"pressure_noise_mbar": 0}, "P1") == {"pressure_noise_mbar": 0.0}


@pytest.mark.parametrize(
    ("name", "most", "expected"),
    [
        ("noise_um", 8e3, "more than 0 and less than 8000"),
        ("pressure_noise_mbar", 500, "0 or more and less than 500"),
    ],
)
def test_no_file_states_a_noise_that_is_larger_than_what_is_measured(
    name, most, expected, tmp_path
):
    """A table could state 900,000 mbar, and was told of 2,000,000 that zero or more is expected."""
    assert checked({name: 0.99 * most}, "P1") == {name: 0.99 * most}
    with pytest.raises(InputError, match=f"^P1: {name} is {most:g}, expected {expected}$"):
        checked({name: most}, "P1")
    campaign = tmp_path / "campaign.toml"
    campaign.write_text(
        f'[campaign]\n{name} = {most:.1f}\n[[curve]]\nfile = "c.csv"\n'
        "aperture_mm = 6.0\nthickness_mm = 1.0\n"
    )
    with pytest.raises(InputError, match=f"campaign.{name} is {most:.1f}, expected {expected}$"):
        read_campaign(campaign)


@pytest.mark.parametrize("field", ["aperture_mm", "thickness_mm", "rest_s", "cycle", "repeats"])
def test_fields_do_not_take_it(field):
    assert complaint(field, "2") is None
    assert f"{field} '0_2': expected" in (complaint(field, "0_2") or "")


def test_conditions_do_not_take_it():
    assert condition_complaint("room_temperature_c", "20") is None
    assert "expected -20 to 60" in (condition_complaint("room_temperature_c", "2_0") or "")
