"""Formats to export to, one file each: a class with its writer and its reader, registered by its name."""
