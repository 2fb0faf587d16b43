"""The paper's tables and figures again, from the paper's own grid, box and formulas.

`study.py` says how much is computed, `cases.py` on which curves, `jobs.py` runs it on all cores.
Each of `tables.py`, `principle.py`, `blind_test.py`, `stand_in.py` and `many_curves.py` makes some
of the parts; `page.py` and `output.py` write them down.
"""
