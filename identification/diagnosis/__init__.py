"""Locate, name, model and prove the physics that a machine's model leaves out."""
