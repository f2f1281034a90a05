"""The commands of ``truepose``, a module for each kind; ``truepose.cli`` puts them together."""
