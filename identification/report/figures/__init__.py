"""Plotly figures of results, one module a subject; ``style`` holds what they share."""
