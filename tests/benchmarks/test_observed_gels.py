"""Tables of errors with exact touches and with touches read in photographs."""

import numpy as np

from benchmarks.observed_gels import EXACT, METRICS, READ, SEEN, tables

ROW = np.arange(1.0, 1 + len(METRICS))


def test_differences_are_paired_relative_and_of_the_objects_that_have_a_part() -> None:
    exact = np.stack([ROW, 3 * ROW])
    exact[1, 1] = np.nan  # the second object has no such part
    found = {SEEN: 4 * exact, EXACT: exact, READ: 1.1 * exact}
    whole, paired, readings = tables(found, [[True, 0.5, 0.1, True, False], [False, 0.0, 0.3, True, True]])
    errors = {row[0]: row[1:] for row in whole.rows}
    differences = {row[0]: row[1:] for row in paired.rows}
    assert errors[EXACT][0] == "2.00 (1.00–3.00)"
    assert errors[EXACT][1].startswith("2.00")
    assert all(cell.startswith("+10.0 ") or cell == "+10.0" for cell in differences[f"{READ} − {EXACT}"])
    assert all(cell.startswith("-75.0") for cell in differences[f"{EXACT} − {SEEN}"])
    assert readings.rows[0][1:] == ("0.500", "0.250", "0.200", "1.000", "0.500")
