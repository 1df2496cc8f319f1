"""What people look at: statistics, tables, contact sheets, galleries."""
