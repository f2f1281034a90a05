"""Good files of every kind that truepose reads, and mutants of them."""
