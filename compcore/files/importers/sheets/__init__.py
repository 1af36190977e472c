"""Small spreadsheets of other programs: their cells, what their columns hold, their moments."""
