"""How results of the kernel show themselves: loaded for what these modules register."""

from truepose.identification.report import files, fitted, frames, views

__all__ = ["files", "fitted", "frames", "views"]
