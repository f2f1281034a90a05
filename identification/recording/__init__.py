"""Recordings: tables read into rows with units, their history and what joints remember."""
