"""A table in a narrow window cuts no number as if it ended there."""

from __future__ import annotations

from textual.app import App

from skinlab.tui.widgets.table import Table


async def test_a_row_says_where_it_goes_on():
    class Narrow(App):
        def compose(self):
            yield Table()

    app = Narrow()
    async with app.run_test(size=(14, 4)) as pilot:
        table = app.query_one(Table)
        table.styles.overflow_x = "hidden"
        table.add_columns("#", "X1 MPa")
        table.add_row("1", "0.021-0.028")
        await pilot.pause()
        assert table.render_line(1).text == " 1  0.021-0.0…"
        await pilot.resize_terminal(18, 4)
        await pilot.pause()
        assert table.render_line(1).text.rstrip() == " 1  0.021-0.028"
        await pilot.resize_terminal(10, 4)
        await pilot.pause()
        table.scroll_to(3, animate=False, force=True)
        await pilot.pause()
        assert table.render_line(1).text == "…0.021-0.…"
