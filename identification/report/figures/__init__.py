"""Charts of results, one module a subject; ``truepose.shown.chart`` says what a chart is."""
