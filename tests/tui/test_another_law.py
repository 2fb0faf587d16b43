"""The screen with the law and the database of the example plugin."""

from __future__ import annotations

import pytest
from fung_table import dimensionless
from skinlab_example.fung import LAW

from skinlab.inference.identify import Identifier
from skinlab.mechanics.materials import with_law
from skinlab.report.rounding import interval_words
from skinlab.tables.store import read
from skinlab.tui.goal import Goal
from skinlab.tui.screens.pick import PickScreen
from skinlab.tui.widgets.curves import Curves

SKIN = """
[skin]
law = "fung"
parameters = { C1_MPa = 0.066, C2 = 11.0, nu = 0.33 }
"""


@pytest.fixture(scope="session")
def identifier(tmp_path_factory):
    with with_law(LAW):
        yield Identifier(read(dimensionless(tmp_path_factory, tmp_path_factory.mktemp("law"))))


def titles(curves):
    return [str(column.label) for column in curves.columns.values()]


@pytest.mark.long
async def test_card_and_rows_speak_of_that_law(bedside, tmp_path):
    skin = tmp_path / "skin.toml"
    skin.write_text(SKIN)
    async with bedside(f"sim://?seed=1&speed=10&skin={skin}", size=(120, 40)) as bed:
        await bed.connected()
        await bed.fill("program", "ramp:60@20")
        await bed.check()
        await bed.press("f9")
        await bed.until(lambda: bed.board.entry and bed.board.entry.result)
        await bed.until(lambda: "C1" in bed.text("#card-text"))
        card = bed.text("#card-text")
        for word in ("C1", "C2", "ν", "ν of linear"):
            assert word in card
        assert "X1" not in card
        curves = bed.app.screen.query_one(Curves)
        await bed.until(lambda: curves.row_count == 1)
        await bed.until(lambda: {"C1 MPa", "C2", "ν"} <= set(titles(curves)))
        found = bed.board.entry.result.parameters
        at = titles(curves).index("C1 MPa")
        assert curves.get_row_at(0)[at].rstrip("?") == interval_words(found["C1_MPa"])
        assert found["C1_MPa"].low <= 0.066 <= found["C1_MPa"].high
        await bed.press("g")
        await bed.on(PickScreen)
        await bed.press("down", "enter")  # and not of the paper's law
        await bed.until(lambda: bed.board.goal == Goal("C1_MPa", 3.0))
        await bed.until(lambda: "goal C1 to ± 3 %" in bed.text("#verdict-next"))
        await bed.quit()
