"""What is printed becomes tables of a page."""

from pipeline.console import print_table
from pipeline.reports.printed_html import printed


def test_tables_keep_titles_columns_cells_and_lines_between_them():
    def show(console):
        console.print("[bold]evaluation[/] of 3 objects")
        print_table(
            console, ("model", 1), [("touch", "0.5\n[dim](0.4–0.6)[/]"), ["[dim]  supplement[/]", "[dim]0.3[/]"]], "Table 3: errors"
        )
        print_table(console, ("class",), [("a",)])

    line, first, second = printed(show)
    assert (line.title, line.columns) == ("evaluation of 3 objects", [])
    assert (first.title, first.columns) == ("Table 3: errors", ["model", "1"])
    assert [row.cells for row in first.rows] == [["touch", "0.5\n(0.4–0.6)"], ["  supplement", "0.3"]]
    assert [row.dim for row in first.rows] == [False, True]
    assert (second.title, second.rows[0].cells) == ("", ["a"])
