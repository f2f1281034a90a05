"""How results show themselves: a screen of text for ``repr``, a table with a picture for notebooks."""
