from __future__ import annotations

import re

import pytest

from skinlab.curves.campaign import read_campaign
from skinlab.curves.placement import placements_of
from skinlab.errors import InputError

CURVE = "time_s,pressure_mbar,deflection_mm\n" + "".join(
    f"{0.1 * i:.1f},{2 * i},{0.01 * i:.2f}\n" for i in range(6)
)
CAMPAIGN = """
[campaign]
title = "forearm"
noise_um = 3.0
pressure_noise_mbar = 0.2

[[curve]]
file = "a.csv"
aperture_mm = 6.0
thickness_mm = 1.0
program = "ramp:100@20"
"""


def write(tmp_path, text):
    (tmp_path / "a.csv").write_text(CURVE)
    path = tmp_path / "campaign.toml"
    path.write_text(text)
    return path


def test_reads_curves_with_their_setups(tmp_path):
    campaign = read_campaign(write(tmp_path, CAMPAIGN))
    assert (campaign.title, campaign.noise_um, campaign.pressure_noise_mbar) == ("forearm", 3, 0.2)
    (curve,) = campaign.curves
    assert curve.setup.aperture_mm == 6
    assert str(curve.setup.program) == "ramp:100@20"
    assert (curve.setup.cycle, curve.setup.repeat) == (1, 1)


def test_a_mark_that_editors_put_in_front_is_no_error(tmp_path):
    path = write(tmp_path, "\ufeff" + CAMPAIGN)
    assert path.read_bytes().startswith(b"\xef\xbb\xbf")
    assert read_campaign(path).title == "forearm"


def test_a_label_of_a_placement_is_local_to_its_campaign(tmp_path):
    entry = CAMPAIGN[CAMPAIGN.index("[[curve]]") :]
    labelled = CAMPAIGN.rstrip() + '\nplacement = "1"\n' + entry.rstrip() + '\nplacement = "1"\n'
    curves = []
    for day in ("monday", "tuesday"):
        (tmp_path / day).mkdir()
        curves += read_campaign(write(tmp_path / day, labelled)).curves
    assert placements_of(curves) == [0, 0, 1, 1]


@pytest.mark.parametrize(
    ("other", "told"),
    [
        ("A", "placements 'a' and 'A' are counted as 2; write them alike where they are one"),
        (" a", "placements 'a' and ' a' are counted as 2; write them alike where they are one"),
        ("b", None),
        ("a", None),
    ],
)
def test_labels_of_placements_that_are_nearly_alike_are_told(tmp_path, capsys, other, told):
    entry = CAMPAIGN[CAMPAIGN.index("[[curve]]") :]
    said = CAMPAIGN.rstrip() + '\nplacement = "a"\n' + 2 * f'{entry}placement = "{other}"\n'
    path = write(tmp_path, said)
    curves = read_campaign(path).curves
    assert len(set(placements_of(curves))) == (1 if other == "a" else 2)
    assert capsys.readouterr().err == (f"skinlab: {path}: {told}\n" if told else "")


@pytest.mark.parametrize("blank", ["", " "])
def test_a_placement_without_a_name_is_none(tmp_path, blank):
    """All curves with an empty label had been of one placement."""
    entry = CAMPAIGN[CAMPAIGN.index("[[curve]]") :] + f'placement = "{blank}"\n'
    path = write(tmp_path, CAMPAIGN + f'placement = "{blank}"\n' + entry)
    assert placements_of(read_campaign(path).curves) == [0, 1]


def test_one_placement_through_several_openings_is_told(tmp_path, capsys):
    """A probe that is put on once has one opening."""
    entry = CAMPAIGN[CAMPAIGN.index("[[curve]]") :]
    other = entry.replace("6.0", "2.0").replace("a.csv", "b.csv")
    (tmp_path / "b.csv").write_text(CURVE)
    labelled = f'{CAMPAIGN}placement = "u"\n' + 2 * f'{other}placement = "u"\n'
    labelled += f'{entry}placement = "v"\n'
    path = write(tmp_path, labelled)
    assert placements_of(read_campaign(path).curves) == [0, 0, 0, 1]
    assert capsys.readouterr().err == (
        f"skinlab: {path}: placement 'u' is counted as one, through openings of 6 mm (a.csv) "
        "and 2 mm (b.csv, b.csv); a probe that is put on once has one: give each a label of its "
        "own\n"
    )


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("noise_um = 3.0", "noise_um = -1", "campaign.noise_um is -1"),
        ("noise_um = 3.0", 'noise_um = "x"', "noise_um"),
        ("title", "titel", "titel"),
        ("thickness_mm = 1.0", "", "thickness_mm"),
        ("aperture_mm = 6.0", "aperture_mm = 5.0", "no probe has this opening"),
        ("ramp:100@20", "ramp:900@20", "curve 1: segment ramp:900@20"),
        ("a.csv", "../a.csv", "outside the folder"),
        ("a.csv", "absent.csv", "No such file"),
        ("a.csv", "", "campaign.toml: curve 1: file '' is a folder; expected a curve CSV"),
        ("[campaign]", "[campaign", "campaign.toml"),
    ],
)
def test_a_wrong_field_is_named(tmp_path, old, new, says):
    path = write(tmp_path, CAMPAIGN.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read_campaign(path)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("entry", "meant"),
    [
        ("[campaign]\nnoise = 3.0", "campaign: unknown field `noise`; did you mean noise_um?"),
        ("[campaign]\n[[curve]]\nfile = 'a'\naperture_mn = 6", "did you mean aperture_mm?"),
    ],
)
def test_an_unknown_key_is_answered_with_the_one_that_was_meant(tmp_path, entry, meant):
    path = tmp_path / "campaign.toml"
    path.write_text(entry)
    with pytest.raises(InputError, match=re.escape(meant)):
        read_campaign(path)
