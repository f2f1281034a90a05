"""From predictions and priors to a machine's constants: least squares, its solvers and estimators."""
