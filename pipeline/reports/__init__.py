"""Reports: statistics, tables, contact sheets, galleries."""
