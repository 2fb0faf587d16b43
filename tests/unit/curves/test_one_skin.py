"""Curves that are fitted together are of one skin, as far as their sessions state."""

import numpy as np
import pytest

from skinlab.curves.curve import Curve, Setup
from skinlab.curves.one_skin import check_one_skin
from skinlab.curves.stated_skin import StatedSkin
from skinlab.errors import InputError

ARM = StatedSkin("arm.h5", "P-1", "forearm")
OTHER = StatedSkin("other.h5", "p-1", "Forearm")
CHEEK = StatedSkin("cheek.h5", "P-1", "cheek")
MAN = StatedSkin("man.h5", "P-2", "cheek")
PLACE = StatedSkin("place.h5", "", "forearm")
WHO = StatedSkin("who.h5", "P-1")


def curve(skin):
    time = np.arange(6.0)
    return Curve("c.csv", Setup(6.0, 1.0), time, 10.0 * time, 0.01 * time, skin=skin)


@pytest.mark.parametrize(
    ("skins", "says"),
    [
        ((ARM, MAN), "arm.h5 is of P-1 and man.h5 of P-2; expected curves of one person"),
        ((None, PLACE, ARM, MAN), "arm.h5 is of P-1 and man.h5 of P-2; expected curves of one"),
        (
            (ARM, WHO, CHEEK),
            "the sites differ (arm.h5 is of forearm and cheek.h5 of cheek); expected curves of one",
        ),
    ],
)
def test_other_people_and_other_sites_are_refused(skins, says):
    with pytest.raises(InputError) as told:
        check_one_skin([curve(skin) for skin in skins])
    assert str(told.value).startswith(says)


@pytest.mark.parametrize(
    ("skins", "notes"),
    [
        ((ARM, ARM, OTHER), ()),
        ((None, None), ()),
        ((ARM, None), ("Nobody stated whose skin was measured: c.csv.",)),
        ((PLACE, ARM), ("Nobody stated whose skin was measured: place.h5.",)),
        ((ARM, WHO), ("Nobody stated the site of who.h5.",)),
    ],
)
def test_what_only_some_state_is_told(skins, notes):
    assert check_one_skin([curve(skin) for skin in skins]) == notes
