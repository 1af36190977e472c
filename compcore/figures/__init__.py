"""Figures of results as plain data; Plotly is imported only where a user asks for its objects."""
