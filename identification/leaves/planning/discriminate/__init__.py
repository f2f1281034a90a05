"""Experiments that tell explanations apart."""
