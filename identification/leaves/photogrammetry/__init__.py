"""Poses of bodies from measured points."""
